#!/usr/bin/env bash
# Writes into .env the digest of each image that compose.yaml names by a tag, so that what runs is what was looked at: a tag
# can be moved, a digest cannot. Run it when a tag is changed, and read what it says before `docker compose up`.
#
#   ./pin.sh [FILE]        asks the registries, and needs the network; or takes what was pulled: docker compose pull
#
# An image that was built here and never pushed has no digest: it stays as it is, and its id is shown.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
env_file=${1:-$here/.env}
[ -w "$env_file" ] || { echo "no $env_file: run make-env.sh first" >&2; exit 1; }

value_of() { sed -n "s/^$1=//p" "$env_file" | tail -n 1; }  # NAME

# Lines such as `versity/versitygw VERSITYGW_TAG v1.8.0 VERSITYGW_DIGEST`, of images as compose.yaml names them.
images() {
  sed -nE 's/^ *image: (&[a-z]+ )?(\$\{FIRSTFIX_REGISTRY:-\})?([^$ ]+):\$\{([A-Z_]+):-([^}]+)\}\$\{([A-Z_]+):-\}$/\2 \3 \4 \5 \6/p' \
    "$here/compose.yaml" | sort -u
}

digest_of() {  # IMAGE
  local found
  found=$(docker image inspect --format '{{range .RepoDigests}}{{println .}}{{end}}' "$1" 2>/dev/null \
    | sed -n "s/.*@\(sha256:[0-9a-f]\{64\}\)$/\1/p" | head -n 1) || true
  if [ -z "$found" ]; then
    found=$(docker buildx imagetools inspect --format '{{.Manifest.Digest}}' "$1" 2>/dev/null \
      | grep -xE 'sha256:[0-9a-f]{64}') || true
  fi
  echo "$found"
}

failed=0
while read -r prefix name tag_variable tag digest_variable; do
  if [ -z "${digest_variable:-}" ]; then  # no registry before it
    digest_variable=$tag tag=$tag_variable tag_variable=$name name=$prefix prefix=''
  else
    name=$(value_of FIRSTFIX_REGISTRY)$name
  fi
  given=$(value_of "$tag_variable")
  image=$name:${given:-$tag}
  digest=$(digest_of "$image")
  if [ -n "$digest" ]; then
    grep -v "^$digest_variable=" "$env_file" >"$env_file.part" || true
    echo "$digest_variable=@$digest" >>"$env_file.part"
    chmod --reference="$env_file" "$env_file.part"
    mv "$env_file.part" "$env_file"
    echo "$image@$digest"
  elif id=$(docker image inspect --format '{{.Id}}' "$image" 2>/dev/null); then
    echo "$image was made on this machine, and has no digest: its id is $id"
  else
    echo "$image: no digest is found: is its registry reached?" >&2
    failed=1
  fi
done < <(images)
exit $failed

#!/usr/bin/env bash
# Runs scripts/check-release.sh, with a build of its own, in clean containers of public base images: each with the interpreter that the image
# or its Debian has. `make release` calls it where Docker runs. An image that is neither here nor to be had is said.
#
#   scripts/check-release-in-containers.sh                        # the images below
#   IMAGES=debian:trixie-slim scripts/check-release-in-containers.sh
set -euo pipefail
cd "$(dirname "$0")/.."
images=${IMAGES:-debian:bookworm-slim python:3.12-slim debian:trixie-slim}
say() { printf 'check-release: %s\n' "$*"; }
docker info >/dev/null 2>&1 || { say "no Docker runs: nothing was tried in containers"; exit 0; }

shared=$(mktemp -d)
trap 'rm -rf "$shared"' EXIT
mkdir "$shared/dist" "$shared/scripts"
cp dist/*-py3-none-any.whl dist/*-linux_"$(uname -m)".whl "$shared/dist/"
cp scripts/check-release.sh scripts/python-of.sh scripts/arm-debian.sh "$shared/scripts/"

for image in $images; do
  if ! docker image inspect "$image" >/dev/null 2>&1 && ! docker pull --quiet "$image" >/dev/null 2>&1; then
    say "no image $image: it was not tried"
    continue
  fi
  say "in a clean container of $image"
  # open3d links these even where there is no screen; libgomp1 is also faiss's.
  docker run --rm --network host --env PIP_INDEX_URL --env PIP_EXTRA_INDEX_URL --env NICENESS="$(nice)" --volume "$shared:/release:ro" "$image" bash -euc '
    export DEBIAN_FRONTEND=noninteractive DEBCONF_NOWARNINGS=yes
    apt-get update -qq
    command -v python3 >/dev/null || apt-get install -qq --no-install-recommends python3 python3-venv >/dev/null
    apt-get install -qq --no-install-recommends libgl1 libegl1 libx11-6 libudev1 libusb-1.0-0 libidn2-0 libgomp1 >/dev/null
    exec nice -n "$NICENESS" /release/scripts/check-release.sh'
done

#!/usr/bin/env bash
# Replaces the full profile's replicas one by one, by ones from the image and settings as they are now, under load: a new one
# is started and is ready before an old one is told to stop. Arguments go to docker compose.
#
#   ./roll.sh [--env-file FILE ...]
set -euo pipefail
cd "$(dirname "$0")"
compose=(docker-compose)
if docker compose version >/dev/null 2>&1; then compose=(docker compose); fi
compose+=("$@" --profile full)

ready() {
  docker exec "$1" python -c "import urllib.request as u; u.urlopen('http://127.0.0.1:8080/readyz', timeout=5)" 2>/dev/null
}

mapfile -t old < <("${compose[@]}" ps -q replica)
[ ${#old[@]} -gt 0 ] || { echo "no replica runs here" >&2; exit 1; }
for replica in "${old[@]}"; do
  mapfile -t before < <("${compose[@]}" ps -q replica)
  "${compose[@]}" up -d --no-deps --no-recreate --scale replica=$((${#old[@]} + 1)) replica >/dev/null 2>&1
  new=$("${compose[@]}" ps -q replica | grep -vxF "$(printf '%s\n' "${before[@]}")" || true)
  [ -n "$new" ] || { echo "no new replica was started" >&2; exit 1; }
  for _ in $(seq 120); do ! ready "$new" || break; sleep 1; done
  ready "$new" || { echo "replica ${new:0:12} is not ready within 120 s" >&2; exit 1; }
  sleep 3  # until the proxy knows it
  docker stop -t 45 "$replica" >/dev/null
  docker rm -v "$replica" >/dev/null
  echo "replica ${replica:0:12} is replaced by ${new:0:12}"
done

#!/usr/bin/env bash
# Proves the images and the compose file: builds them, brings them up on an empty volume, posts a sample
# world's map, waits for the build, and localizes the world's scans at both, over HTTP and zenoh.
# Needs docker, docker-compose (either generation) and curl. Ports 8080, 8081, 7447 and 7448 must be free.
#
#   deploy/smoke.sh
#   WORLD=campus DOCKER_BUILD_ARGS="--network host" deploy/smoke.sh
set -euo pipefail
cd "$(dirname "$0")/.."

world=${WORLD:-factory}  # the demo's; the bar below is set for it, and the ambiguous office would not reach it
project=firstfix-smoke
compose=(docker-compose)
if docker compose version >/dev/null 2>&1; then compose=(docker compose); fi
compose+=(-p "$project" -f deploy/compose.yaml)
work=$(mktemp -d)
chmod 755 "$work"  # the user in the containers is another one

say() { printf '\nsmoke %4d s: %s\n' "$SECONDS" "$*"; }
finish() {
  local status=$?
  [ $status = 0 ] || "${compose[@]}" logs --tail 40 || true
  "${compose[@]}" down --volumes --timeout 10 >/dev/null 2>&1 || true
  rm -rf "$work"
  exit $status
}
trap finish EXIT

say "building the images"
read -r -a build_args <<<"${DOCKER_BUILD_ARGS:-}"
for target in service builder; do
  docker build --quiet "${build_args[@]}" --target $target -t firstfix-$target .
done
docker image ls --format '{{.Repository}}  {{.Size}}' | grep '^firstfix-'

say "making the $world world"
docker run --rm --user "$(id -u):$(id -g)" -v "$work:/world" firstfix-builder world "$world" -o /world
config=$(docker run --rm -v "$work:/world:ro" --entrypoint python firstfix-builder -c \
  'import json, yaml; print(json.dumps({"sensor": yaml.safe_load(open("/world/sensor.yaml"))}))')

say "starting on an empty volume"
"${compose[@]}" up -d --no-build
curl -fsS --retry 30 --retry-delay 1 --retry-all-errors http://127.0.0.1:8080/readyz

say "posting the map"
build=$(curl -fsS -D - -o /dev/null http://127.0.0.1:8080/maps \
  -F map_id=smoke -F source=@"$work/map.ply" -F trajectory=@"$work/trajectory.txt" -F config="$config" \
  | tr -d '\r' | sed -n 's/^[Ll]ocation: //p')
state=queued
until [ "$state" = succeeded ]; do
  sleep 2
  status=$(curl -fsS "http://127.0.0.1:8080$build")
  state=$(sed -n 's/.*"state": *"\([a-z]*\)".*/\1/p' <<<"$status")
  case $state in failed | cancelled) echo "$status"; exit 1 ;; esac
done
say "built: $status"

# A robot beside the services, in a container of its own with nothing but the network and the scans.
for where in "--url http://firstfix:8080" "--url http://replica:8080" "--zenoh tcp/replica:7447"; do
  say "localizing, $where"
  docker run --rm --network "${project}_default" -v "$work:/world:ro" --entrypoint sh firstfix-service -c "
    firstfix evaluate /world/poses.csv --map smoke $where --json /tmp/evaluation.json
    python -c 'import json; got = json.load(open(\"/tmp/evaluation.json\")); assert got[\"success_0.2m\"] >= 0.8, got'"
done

for service in firstfix replica; do
  id=$("${compose[@]}" ps -q $service)
  health=$(docker inspect -f '{{.State.Health.Status}}' "$id")
  user=$("${compose[@]}" exec -T $service python -c 'import os; print(os.getuid())' | tr -d '\r')
  say "$service: $health, user $user"
  [ "$health" = healthy ] && [ "$user" != 0 ]
done
say "all good"

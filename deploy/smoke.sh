#!/usr/bin/env bash
# Proves the images and the compose file: brings a profile up on empty volumes with secrets of its own, hands in a map, waits
# for the build, localizes a sample world's scans over HTTP and zenoh, rolls a version back, and tears everything down.
# With `full` it also kills a replica, a worker in the middle of a build and the S3 gateway, and replaces all replicas, while
# robots go on asking: none may see an error, or a wrong pose. `dask` is `full` with builds that are shared over Dask, whose worker
# is killed in place of the build worker.
#
#   deploy/smoke.sh [minimal|full|dask]
#   FIRSTFIX_HTTP_PORT=18080 FIRSTFIX_ZENOH_PORT=17447 JSON=figures.json deploy/smoke.sh full
#
# Needs docker, docker-compose (either generation), curl, and the images; BUILD=1 makes those first (DOCKER_BUILD_ARGS are
# for docker build). Every container it starts is of the compose project firstfix-smoke-PROFILE, or named so.
set -euo pipefail
cd "$(dirname "$0")/.."
profile=${1:-minimal}
profiles=("$profile") victim=worker
world=${WORLD:-factory}  # the ambiguous office would not reach the share below
least=${LEAST:-0.6}      # of the map's scans to be localized
build_s=${BUILD_S:-600}  # within which a build has to end
# For the builds' configs: a coarser map with a shorter self-test, which is sure of fewer scans, in a third of the time.
quick=', "clean": {"voxel_m": 0.15}, "viewpoints": {"spacing_m": 1.5}, "self_test": {"queries": 60, "outside": 20}'
project=firstfix-smoke-$profile
work=$(mktemp -d)
chmod 755 "$work"  # the user in the containers is another one
case $profile in
  minimal) taker=firstfix front=firstfix zenoh=tcp/firstfix:7447 ;;
  full | dask) taker=replica front=proxy zenoh=/world/robot.json5 ;;
  *) echo "minimal, full or dask, not $profile" >&2; exit 2 ;;
esac
if [ "$profile" = dask ]; then profiles=(full dask) victim=dask-worker; fi
source deploy/smoke/parts.sh

trap finish EXIT
if [ -n "${BUILD:-}" ]; then
  read -r -a build_args <<<"${DOCKER_BUILD_ARGS:-}"
  deploy/image/build.sh "${build_args[@]}"
  [ "$profile" = minimal ] || deploy/stand-ins/build.sh
fi

say "making the $world world"
make_world

say "starting the profile $profile on empty volumes"
make_settings
"${compose[@]}" up -d
wait_until_ready
robot_key=$("${compose[@]}" exec -T "$taker" firstfix keys create --scope localize --map smoke --name robots 2>/dev/null | tr -d '\r')

say "without a key nobody gets in"
[ "$(curl -s -o /dev/null -w '%{http_code}' "$url/maps")" = 401 ]

say "handing in the map"
build=$(hand_in "$quick, \"learn_keys\": {\"scans\": 300}")
first=$(wait_for_build "$build")
say "version ${first:0:12} is built"

say "every scan once, over HTTP and zenoh"
sleep 3  # a replica looks for new versions every 2 s
robots once --rounds 1 --least "$least"
check_containers

if [ "$profile" != minimal ]; then
  say "robots go on asking, and what serves them is killed"
  robots_begin chaos
  build=$(hand_in "${quick/0.15/0.16}, \"learn_keys\": {\"scans\": 300}")  # another map: nothing is done already
  wait_for_stage "$build"
  crash "$victim"
  sleep 2
  crash replica
  say "the S3 gateway is away for 8 s"
  gateway=$("${compose[@]}" ps -q s3)
  docker stop -t 1 "$gateway" >/dev/null
  sleep 8
  docker start "$gateway" >/dev/null
  second=$(wait_for_build "$build")
  say "version ${second:0:12} is built all the same"
  [ "$profile" != dask ] || check_dask_workers
  sleep 5
  robots_end chaos
  check_restarts
else
  build=$(hand_in "$quick, \"learn_keys\": {\"scans\": 200}")
  second=$(wait_for_build "$build")
fi
[ "$second" != "$first" ]

say "rolling back to ${first:0:12}"
wait_for_version "$second"
call -X POST "$url/maps/smoke/rollback" >/dev/null
wait_for_version "$first"

if [ "$profile" != minimal ]; then
  say "replacing all replicas under robots that never try again"
  robots_begin rolling --no-retry --pause 0.02
  deploy/compose/roll.sh --env-file "$work/env" -p "$project"
  sleep 3
  robots_end rolling
  wait_for_metrics
fi
figures
say "all good"

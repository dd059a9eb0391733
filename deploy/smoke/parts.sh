# shellcheck shell=bash
# What deploy/smoke.sh is made of; it sets profile, profiles, project, work, world, taker, front, zenoh and build_s.

compose=(docker-compose)
if docker compose version >/dev/null 2>&1; then compose=(docker compose); fi
compose+=(-f deploy/compose/compose.yaml --env-file "$work/env" -p "$project" "${profiles[@]/#/--profile=}")
url=http://127.0.0.1:${FIRSTFIX_HTTP_PORT:-8080}

say() { printf '\nsmoke %4d s: %s\n' "$SECONDS" "$*"; }
fail() { printf 'smoke: %s\n' "$*" >&2; exit 1; }

finish() {
  local status=$?
  if [ -e "$work/env" ]; then
    [ $status = 0 ] || "${compose[@]}" logs --no-color --tail 15 || true
    docker ps -aq --filter "name=^$project-robots-" | xargs -r docker rm -fv >/dev/null 2>&1 || true
    "${compose[@]}" down --volumes --timeout 10 >/dev/null 2>&1 || true
  fi
  rm -rf "$work"
  exit $status
}

make_world() {
  docker run --rm --user "$(id -u):$(id -g)" -v "$work:/world" "firstfix-builder:${FIRSTFIX_TAG:-latest}" world "$world" -o /world
  sensor=$(docker run --rm -v "$work:/world:ro" --entrypoint python "firstfix-builder:${FIRSTFIX_TAG:-latest}" -c \
    'import json, yaml; print(json.dumps(yaml.safe_load(open("/world/sensor.yaml"))))')
  mkdir -m 777 "$work/out"
}

make_settings() {
  deploy/compose/make-env.sh "$work/env" >/dev/null
  # What comes later counts: the test's own ports, no limit for its few callers, and a dead worker is found out sooner.
  cat >>"$work/env" <<EOF
COMPOSE_PROFILES=$(IFS=,; echo "${profiles[*]}")
COMPOSE_PROJECT_NAME=$project
FIRSTFIX_HTTP_PORT=${FIRSTFIX_HTTP_PORT:-8080}
FIRSTFIX_ZENOH_PORT=${FIRSTFIX_ZENOH_PORT:-7447}
PROMETHEUS_PORT=${PROMETHEUS_PORT:-9090}
FIRSTFIX_LOCALIZE_PER_S=0
FIRSTFIX_BUILD_LEASE_S=10
EOF
  [ "$profile" != dask ] || echo "FIRSTFIX_BUILD_EXECUTOR=dask://dask-scheduler:8786" >>"$work/env"
  admin_key=$(sed -n 's/^FIRSTFIX_ADMIN_KEY=//p' "$work/env")
  robot_password=$(sed -n 's/^ZENOH_ROBOT_PASSWORD=//p' "$work/env")
  cat >"$work/robot.json5" <<EOF
{
  mode: "client",
  connect: { endpoints: ["tcp/zenoh:7447"] },
  scouting: { multicast: { enabled: false } },
  transport: { auth: { usrpwd: { user: "robot", password: "$robot_password" } } },
}
EOF
}

call() { curl -fsS -H "Authorization: Bearer $admin_key" "$@"; }
field() { sed -n "s/.*\"$1\": *\"\([^\"]*\)\".*/\1/p"; }

wait_until_ready() {
  curl -fsS --retry 90 --retry-delay 1 --retry-all-errors "$url/readyz" 2>/dev/null || fail "not ready within 90 s"
  echo
}

hand_in() {  # FIELDS of the build config besides the sensor, prints the path of the build's status
  call -D - -o /dev/null "$url/maps" -F map_id=smoke -F source=@"$work/map.ply" \
    -F trajectory=@"$work/trajectory.txt" -F config="{\"sensor\": $sensor$1}" \
    | tr -d '\r' | sed -n 's/^[Ll]ocation: //p'
}

wait_for_build() {  # prints its version
  local status='' state end=$((SECONDS + build_s))
  while [ $SECONDS -lt $end ]; do
    sleep 1
    status=$(call "$url$1" 2>/dev/null || true)  # 503 while the gateway is away
    state=$(field state <<<"$status")
    case $state in
      succeeded) field version <<<"$status"; return ;;
      failed | cancelled) fail "the build ended: $status" ;;
    esac
  done
  fail "the build did not end within $build_s s: $status"
}

wait_for_stage() {  # until a build is in the middle of its work
  local stage='' end=$((SECONDS + build_s))
  while [ $SECONDS -lt $end ]; do
    stage=$(call "$url$1" | field stage)
    case $stage in '' | fetch_source | read_map) sleep 0.5 ;; *) say "the build is at: $stage"; return ;; esac
  done
  fail "the build does not begin"
}

wait_for_version() {  # until it is the one that answers
  for _ in $(seq 60); do
    if [ "$(call "$url/maps/smoke" | field active_version)" = "$1" ]; then return; fi
    sleep 0.5
  done
  fail "version $1 is not active: $(call "$url/maps/smoke")"
}

# As after a crash, and not as after `docker kill`, which the restart policy takes for what the operator wants.
crash() {  # SERVICE: kills every process of one of its containers but init, which ends then
  local id
  if [ "$1" = worker ]; then id=$(busy_worker); else id=$("${compose[@]}" ps -q "$1" | sed -n 1p); fi
  say "killing $1 ${id:0:12}"
  docker exec "$id" sh -c 'kill -9 -1' || true
  crashed+=("$id")
}
crashed=()

check_restarts() {  # what crashed runs again; a worker that came back to no store may have had to do so twice
  local id
  for id in "${crashed[@]}"; do
    case $(docker inspect -f '{{.State.Running}} {{.RestartCount}}' "$id") in
      "true 0" | false*) fail "${id:0:12} did not come back" ;;
    esac
  done
}

check_dask_workers() {  # each has read stages of a build from the store, and so has made chunks
  local id
  for id in $("${compose[@]}" ps -q dask-worker); do
    docker exec "$id" sh -c 'find /var/lib/firstfix -name stage.json | grep -q .' || fail "${id:0:12} did nothing"
  done
  say "the Dask workers have shared the build"
}

busy_worker() {  # the worker in which a build's process runs
  local id
  for id in $("${compose[@]}" ps -q worker); do
    # The brackets keep this shell and this grep from finding themselves.
    if docker exec "$id" sh -c 'grep -qs "firstfix_builder[.]worker" /proc/[0-9]*/cmdline'; then
      echo "$id"
      return
    fi
  done
  fail "no worker builds"
}

robots() {  # NAME OPTION...: in a container of their own, with nothing but the network, the scans and a robot's key
  local name=$1
  shift
  docker run --name "$project-robots-$name" --network "${project}_default" -v "$work:/world:ro" -v "$work/out:/out" \
    -v "$PWD/deploy/smoke/robots.py:/robots.py:ro" -e FIRSTFIX_API_KEY="$robot_key" -e OPENBLAS_NUM_THREADS=1 \
    --init --entrypoint python "${detached[@]}" "firstfix-service:${FIRSTFIX_TAG:-latest}" \
    /robots.py /world smoke --url "http://$front:8080" --zenoh "$zenoh" --json "/out/$name.json" "$@"
}
detached=()

robots_begin() { detached=(--detach); robots "$@" >/dev/null; detached=(); }

robots_end() {  # NAME: they must not have seen an error
  local status
  docker stop -t 60 "$project-robots-$1" >/dev/null
  status=$(docker inspect -f '{{.State.ExitCode}}' "$project-robots-$1")
  docker logs "$project-robots-$1" 2>&1 | tail -5
  [ "$status" = 0 ] || fail "the robots of '$1' were not content"
}

check_containers() {  # healthy, not root, nothing to write to but what is meant for it
  local service id user
  for service in "$taker" $([ "$profile" = minimal ] || echo worker); do
    for id in $("${compose[@]}" ps -q "$service"); do
      for _ in $(seq 30); do
        [ "$(docker inspect -f '{{.State.Health.Status}}' "$id")" != healthy ] || break
        sleep 1
      done
      user=$(docker exec "$id" python -c 'import os; print(os.getuid())')
      say "$service ${id:0:12}: $(docker inspect -f '{{.State.Health.Status}}' "$id"), user $user"
      [ "$(docker inspect -f '{{.State.Health.Status}}' "$id")" = healthy ] && [ "$user" = 10001 ]
      ! docker exec "$id" sh -c 'touch /opt/firstfix/x' 2>/dev/null || fail "its root file system can be written to"
    done
  done
}

wait_for_metrics() {  # Prometheus has scraped every replica, with its key
  local up=''
  for _ in $(seq 60); do
    up=$(curl -fsS "http://127.0.0.1:${PROMETHEUS_PORT:-9090}/api/v1/query" --data-urlencode 'query=sum(up{job="firstfix"})' || true)
    case $up in *'"2"'*) say "Prometheus sees both replicas"; return ;; esac
    sleep 1
  done
  fail "Prometheus does not see the replicas: $up"
}

figures() {
  if [ -n "${JSON:-}" ]; then
    { for part in "$work"/out/*.json; do printf '"%s": ' "$(basename "$part" .json)"; cat "$part"; echo ,; done; } \
      | sed '$ d' | { echo '{'; cat; echo '}'; } >"$JSON"
  fi
}

#!/usr/bin/env bash
# Installs the wheels of dist/ into clean virtual environments, one for each interpreter that they are for, and uses them: a build, a
# service and a fix with the house, a fix with the robot's side alone. `make release` calls it. The wheel for ARM is tried in an emulated
# Debian (scripts/arm-debian.sh), where root may make one.
#
#   scripts/check-release.sh                  # all wheels of dist/
#   PYTHONS=3.12 scripts/check-release.sh     # for this interpreter alone
#   BUILT=DIR scripts/check-release.sh        # with DIR/world and DIR/store, so that no map is built
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/python-of.sh
dist=$PWD/dist
arm_debian=$PWD/scripts/arm-debian.sh
arm_root=$PWD/build/release/arm64
scratch=$(mktemp -d)
service=
trap '[ -z "$service" ] || kill "$service" 2>/dev/null || true; rm -rf "$scratch"' EXIT
# Nothing of the checkout: not its modules, not the user's cache of versions.
cd "$scratch"
unset PYTHONPATH
[ -z "${BUILT:-}" ] || cp -r "$BUILT/world" "$BUILT/store" .
export XDG_CACHE_HOME=$scratch/cache PIP_DISABLE_PIP_VERSION_CHECK=1
version=$(basename "$(compgen -G "$dist/firstfix_client-*.whl")" | cut -d- -f2)
say() { printf 'check-release: %s\n' "$*"; }

# An environment with the requirements, in which nothing is compiled. RUN is what a command of the house is run by: nothing, or the emulation.
run=()
environment() {
  local folder=$1 python=$2
  shift 2
  "${run[@]}" "$python" -m venv "$folder"
  "${run[@]}" "$folder/bin/pip" install --quiet --only-binary :all: "$@"
}

# A service of the house on the store, until it is ready. Sets $service and $url; HOST_PYTHON asks it.
serve() {
  local house=$1 port
  port=$("$host_python" -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
  url=http://127.0.0.1:$port
  "${run[@]}" "$house/firstfix" serve --store store --port "$port" --work work >service.log 2>&1 &
  service=$!
  for _ in $(seq 900); do # the emulation takes minutes
    if "$host_python" -c "import urllib.request as u; u.urlopen('$url/readyz', timeout=2)" 2>/dev/null; then return; fi
    kill -0 "$service" 2>/dev/null || break
    sleep 1
  done
  cat service.log >&2
  say "the service did not start"
  exit 1
}

end_service() {
  kill "$service"
  wait "$service" || true
  service=
}

robot() {
  "$1" -c '
import csv, sys
from firstfix_client import Client, __version__
url, version = sys.argv[1:]
assert __version__ == version, __version__
row = next(csv.DictReader(open("world/poses.csv")))
with Client(url, timeout_s=120) as client:
    fix = client.localize("world/" + row["scan"], map_id="factory")
error_m = sum((float(row[axis]) - at) ** 2 for axis, at in zip(("tx", "ty", "tz"), fix.T_map_sensor[:3, 3])) ** 0.5
assert error_m < 0.2, error_m
print(f"check-release:   a fix of {__version__}, {error_m:.3f} m off")
' "$url" "$version"
}

name=firstfix
checked=0
for wheel in "$dist"/firstfix-"$version"-cp*-linux_"$(uname -m)".whl; do
  tag=$(basename "$wheel" | cut -d- -f3)
  release=3.${tag#cp3}
  case " ${PYTHONS:-$release} " in *" $release "*) ;; *) continue ;; esac
  python=$(python_of "$release") || true
  [ -n "$python" ] || { say "no Python $release: $(basename "$wheel") was not tried"; continue; }
  say "the house on Python $release"
  host_python=$python
  environment house "$python" "$name[service,builder] @ file://$wheel" \
    "$dist"/firstfix_{console,fleet}-"$version"-*.whl
  house=$scratch/house/bin
  [ "$("$house/firstfix" --version)" = "firstfix $version" ]
  if [ ! -d world ]; then # one build for all: the map of a wheel is read by the others
    "$house/firstfix" world factory -o world >/dev/null
    "$house/firstfix" build world/map.ply --map-id factory --store store --sensor world/sensor.yaml --note "a release"
  fi
  serve "$house"
  robot "$house/python"
  "$house/firstfix" maps ls --url "$url"
  for client in 3.10 "$release"; do
    python=$(python_of "$client") || true
    [ -n "$python" ] || { say "no Python $client: the robot's side was not tried there"; continue; }
    say "the robot's side on Python $client"
    rm -rf robot
    environment robot "$python" "$dist"/firstfix_client-"$version"-py3-none-any.whl
    robot robot/bin/python
  done
  end_service
  rm -rf house
  checked=$((checked + 1))
done
[ "$checked" -gt 0 ] || { say "no wheel could be tried"; exit 1; } >&2

# Debian 12's own interpreter is 3.11. The emulation is slow, so the version that was built above is served, and no map is built.
for wheel in "$dist"/firstfix-"$version"-cp*-linux_aarch64.whl; do
  [ "$(uname -m)" = x86_64 ] && [ -f "$wheel" ] || continue
  case $wheel in
    *-cp311-*) missing=$("$arm_debian" make "$arm_root" 2>&1) || { say "$(basename "$wheel") was built, and not run: $missing"; continue; } ;;
    *) say "$(basename "$wheel") was built, and not run: the emulated Debian has Python 3.11 alone"; continue ;;
  esac
  say "the house on ARM, emulated"
  run=("$arm_debian" run "$arm_root" "$scratch" "$dist" --)
  environment house /usr/bin/python3 "$name[service] @ file://$wheel"
  serve "$scratch/house/bin"
  run=()
  rm -rf robot
  environment robot "$host_python" "$dist"/firstfix_client-"$version"-py3-none-any.whl
  robot robot/bin/python
  end_service
  checked=$((checked + 1))
done
say "$checked wheels of the house, and the robot's side, were installed and gave a fix"

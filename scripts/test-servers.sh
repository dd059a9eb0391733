#!/usr/bin/env bash
# Puts real servers beside the tests' Python. Tests whose server or tool cannot be had are skipped and say so.
#
#   scripts/test-servers.sh        # of `make test`: versitygw (S3), mosquitto (MQTT), Chromium for the console, what the
#                                  # C++ client is built with, ROS 2 Jazzy. nats-server comes with .venv.
#   scripts/test-servers.sh all    # of `make test-slow` too: Azurite (Azure), toxiproxy (broken networks), HAProxy (replicas),
#                                  # iproute2 (a weak link), helm with the schemas of Kubernetes and prometheus-operator,
#                                  # ROS 2 Kilted, a compiler for ARM with an emulator and the C++ client's libraries. Rust, which builds a robot of another DDS, is only looked for.
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$PWD/.venv/bin

say() { echo "test-servers: $*"; }

# NAME PACKAGE@VERSION: `go install` names the program after its package's last folder.
build() {
  local name=$1 package=$2 made
  if [ -x "$bin/$name" ] || command -v "$name" >/dev/null; then return 0; fi
  command -v go >/dev/null || { say "no go here, so the tests with $name will be skipped"; return 0; }
  say "building $name ${package##*@}"
  made=$(mktemp -d)
  if GOBIN=$made timeout 900 go install "$package"; then
    mv "$made"/* "$bin/$name"
  else
    say "$name could not be built, so its tests will be skipped"
  fi
  rm -rf "$made"
}

# FOLDER PACKAGE@VERSION: npm's packages are a tree, which gets a folder of .venv. One that could not be had is
# left empty, and not tried again before `make clean`.
npm_tree() {
  local folder=.venv/$1 package=$2
  if [ -d "$folder" ]; then return 0; fi
  command -v npm >/dev/null || { say "no npm here, so the tests with $1 will be skipped"; return 0; }
  say "installing $package"
  timeout 300 npm install --silent --fetch-retries=1 --no-audit --no-fund --prefix "$folder" "$package" >/dev/null || {
    rm -rf "$folder"
    mkdir "$folder"
    say "$package could not be installed, so its tests will be skipped"
  }
}

# TESTS PACKAGE...: what is skipped without them.
system_packages() {
  local tests=$1
  shift
  if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    say "this is not root: without $* $tests will be skipped"
    return 0
  fi
  say "installing $*"
  export DEBIAN_FRONTEND=noninteractive RUNLEVEL=1  # nothing is started by its installation
  { apt-get install -y -qq --no-install-recommends "$@" ||
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends "$@"; }; } >/dev/null 2>&1 ||
    say "$* could not be installed, so $tests will be skipped"
}
have() { local name; for name in "$@"; do command -v "$name" >/dev/null || return 1; done; }

build versitygw github.com/versity/versitygw/cmd/versitygw@v1.8.0
have mosquitto || [ -x /usr/sbin/mosquitto ] || system_packages "the tests of VDA 5050" mosquitto
have chromium-headless-shell || have chromium || system_packages "the console's tests" chromium-headless-shell
{ have cmake c++ make pkg-config && pkg-config --exists libzstd libcurl libcrypto nlohmann_json; } ||
  system_packages "the C++ client's tests" \
    cmake g++ make pkg-config libzstd-dev libcurl4-openssl-dev libssl-dev nlohmann-json3-dev
scripts/ros2.sh jazzy
[ "${1:-}" = all ] || exit 0

build toxiproxy-server github.com/Shopify/toxiproxy/v2/cmd/server@v2.12.0
build helm helm.sh/helm/v3/cmd/helm@v3.19.0
npm_tree kubernetes-models @kubernetes-models/prometheus-operator@6.0.0
command -v azurite-blob >/dev/null || npm_tree azurite azurite@3.35.0
if [ -x .venv/azurite/node_modules/.bin/azurite-blob ]; then
  ln -sf ../azurite/node_modules/.bin/azurite-blob "$bin/azurite-blob"
fi

have haproxy || system_packages "the replicas' tests" haproxy
have ip || system_packages "the weak link's test" iproute2
# What the C++ client is built with for ARM, in a folder: this machine keeps its own architecture.
arm_libraries() {
  local folder=.venv/arm-libraries made own deb
  if [ -d "$folder" ]; then return 0; fi
  have apt-get dpkg || { say "no apt-get here, so the tests of robots on ARM will be skipped"; return 0; }
  say "getting libssl-dev and libzstd-dev for ARM"
  made=$(mktemp -d)
  mkdir -p "$made"/{state/lists/partial,cache/archives/partial,debs,tree}
  own=(-o APT::Architecture=arm64 -o APT::Architectures::=arm64 -o Dir::State="$made/state" -o Dir::State::status=/dev/null
    -o Dir::Cache="$made/cache" -o APT::Sandbox::User=root)
  if (apt-get "${own[@]}" update -qq && cd "$made/debs" && apt-get "${own[@]}" download -qq libssl-dev libssl3 libzstd-dev libzstd1) >/dev/null 2>&1; then
    for deb in "$made"/debs/*.deb; do dpkg -x "$deb" "$made/tree"; done
    mv "$made/tree" "$folder"
  else
    say "they could not be had, so the tests of robots on ARM will be skipped"
  fi
  rm -rf "$made"
}

have aarch64-linux-gnu-g++ qemu-aarch64 || system_packages "the tests of robots on ARM" g++-aarch64-linux-gnu qemu-user
arm_libraries
have cargo || say "no cargo here, so the tests with a robot of another DDS will be skipped"
scripts/ros2.sh kilted

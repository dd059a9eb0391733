#!/usr/bin/env bash
# Builds the wheels of a release into dist/, and checks them in clean environments (scripts/check-release.sh) and in clean containers
# (scripts/check-release-in-containers.sh). `make release` calls it.
#
#   dist/firstfix-VERSION-cp3XX-cp3XX-linux_x86_64.whl    the house, for each interpreter that is found
#   dist/firstfix-VERSION-cp3XX-cp3XX-linux_aarch64.whl   the same, where g++-aarch64-linux-gnu is installed
#   dist/firstfix_client-VERSION-py3-none-any.whl         the robot's side alone, Python 3.10 too
#   dist/firstfix_{console,fleet,lab}-VERSION-py3-...whl  what may be left out
#   dist/NOTES.md, dist/SHA256SUMS
#
#   PYTHONS="3.11 3.12" scripts/release.sh                # for these alone; what is not found is said
#   MODULES=avx2 CHECK=no scripts/release.sh              # for a try: one instruction set, nothing installed
#
# Interpreters are python3.X of the PATH, or those of pyenv. A wheel holds for this machine's C library and newer ones.
set -euo pipefail
cd "$(dirname "$0")/.."
version=$(sed -n 's/^__version__ = "\(.*\)"/\1/p' core/firstfix/__init__.py)
build=$PWD/build/release
machine=$(uname -m)
say() { printf 'release: %s\n' "$*"; }

. scripts/python-of.sh

# The tools of the locks, in an environment of their own.
tools_of() {
  [ -x "$build/tools$1/bin/pip" ] || "$2" -m venv "$build/tools$1"
  "$build/tools$1/bin/pip" install --quiet --disable-pip-version-check --require-hashes -r deploy/locks/setup.txt >&2
  echo "$build/tools$1/bin"
}

wheel() {
  local bin=$1
  shift
  PATH=$bin:$PATH "$bin/pip" wheel --quiet --disable-pip-version-check --no-deps --no-build-isolation --wheel-dir dist "$@"
}

# The house for another processor family: its compiler, its names, and the headers of this interpreter, which are the same on both.
arm_wheel() {
  local bin=$1 tag=$2
  CC=aarch64-linux-gnu-gcc CXX=aarch64-linux-gnu-g++ _PYTHON_HOST_PLATFORM=linux-aarch64 \
    SETUPTOOLS_EXT_SUFFIX=".cpython-$tag-aarch64-linux-gnu.so" ARCHFLAGS="" \
    CMAKE_ARGS="-DCMAKE_SYSTEM_NAME=Linux -DCMAKE_SYSTEM_PROCESSOR=aarch64" \
    wheel "$bin" --config-settings=build-dir="$build/native-$tag-aarch64" .
}

rm -rf dist
mkdir -p dist "$build"
tools=
for release in ${PYTHONS:-3.11 3.12 3.13 3.14}; do
  python=$(python_of "$release") || true
  if [ -z "$python" ]; then
    say "no Python $release was found: no wheel for it"
    continue
  fi
  tools=$(tools_of "$release" "$python")
  say "the house for Python $release, $machine"
  wheel "$tools" --config-settings=build-dir="$build/native-$release-$machine" \
    --config-settings=cmake.define.FIRSTFIX_MODULES="${MODULES:-}" .
  if [ "$machine" = x86_64 ] && command -v aarch64-linux-gnu-g++ >/dev/null; then
    say "the house for Python $release, aarch64"
    arm_wheel "$tools" "${release/./}"
  fi
done
[ -n "$tools" ] || { say "no interpreter was found"; exit 1; } >&2
command -v aarch64-linux-gnu-g++ >/dev/null || say "no wheel for ARM: g++-aarch64-linux-gnu is not installed"

say "the robot's side, and the packages that may be left out"
PYTHON=$tools/python plugins/console/build.sh
[ -f plugins/console/firstfix_console/files/index.html ] || { say "the console's page could not be built"; exit 1; } >&2
wheel "$tools" ./clients/python ./plugins/console ./plugins/fleet ./lab

# The notes of this release are the beginning of its section of the changelog, before what was added and changed.
awk -v wanted="## $version" 'index($0, "##") == 1 { on = index($0, wanted) == 1 } on' CHANGELOG.md >dist/NOTES.md
[ -s dist/NOTES.md ] || { say "CHANGELOG.md has no section $version"; exit 1; } >&2
(cd dist && sha256sum -- *.whl NOTES.md >SHA256SUMS)
if [ "${CHECK:-yes}" != no ]; then
  scripts/check-release.sh
  scripts/check-release-in-containers.sh
fi
ls -l dist

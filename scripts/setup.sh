#!/usr/bin/env bash
# Makes .venv, ready to run, test and build firstfix, from the hash-pinned locks. `make setup`, which builds the compiled core
# besides, calls this when .venv/.ready is older than the locks, pyproject.toml or this script; running it twice is harmless.
#
#   PYTHON=python3.12 make setup     # another interpreter than the first suitable one on the PATH
set -euo pipefail
cd "$(dirname "$0")/.."

say() { printf 'setup: %s\n' "$*"; }
fail() { printf 'setup: %s\n' "$*" >&2; exit 1; }

# open3d links these even where there is no screen; libgomp1 is also faiss's.
system_packages=(libgl1 libegl1 libx11-6 libudev1 libusb-1.0-0 libidn2-0 libgomp1)

suitable() {
  command -v "$1" >/dev/null && "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null
}

find_python() {
  local name
  for name in ${PYTHON:-python3 python3.13 python3.12 python3.11}; do
    if suitable "$name"; then echo "$name"; return; fi
  done
  return 1
}

# Debian ships ensurepip apart from the interpreter, in pythonX.Y-venv.
venv_package() {
  "$1" -c 'import ensurepip, venv' 2>/dev/null || "$1" -c 'import sys; print("python%d.%d-venv" % sys.version_info[:2])'
}

# What the compiled core is built with, besides the locked CMake and Ninja. Nothing where a wheel has it (scripts/native.sh).
compiler_packages() {
  if compgen -G "dist/firstfix-*.whl" >/dev/null; then return; fi
  command -v "${CXX:-c++}" >/dev/null || echo g++
  # Debian ships the headers apart from the interpreter.
  "$1" -c 'import sysconfig, pathlib, sys; sys.exit(not pathlib.Path(sysconfig.get_path("include"), "Python.h").is_file())' \
    || "$1" -c 'import sys; print("python%d.%d-dev" % sys.version_info[:2])'
}

install_system_packages() {
  command -v dpkg >/dev/null && command -v apt-get >/dev/null || { say "not Debian or Ubuntu: needs the equivalent of ${system_packages[*]}"; return; }
  local missing=() name become=()
  for name in "$@"; do
    [ "$(dpkg-query -W -f '${db:Status-Status}' "$name" 2>/dev/null)" = installed ] || missing+=("$name")
  done
  [ ${#missing[@]} -gt 0 ] || return 0
  if [ "$(id -u)" != 0 ]; then
    sudo -n true 2>/dev/null || fail "missing system packages. Run this, then again:
  sudo apt-get update && sudo apt-get install -y --no-install-recommends ${missing[*]}"
    become=(sudo -n)
  fi
  say "installing ${missing[*]}"
  export DEBIAN_FRONTEND=noninteractive
  local install=("${become[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}") log
  log=$(mktemp)
  # The package lists of a fresh machine are empty or old: fetch them only where the first try fails.
  "${install[@]}" >"$log" 2>&1 || { "${become[@]}" apt-get update -qq >>"$log" 2>&1 && "${install[@]}" >>"$log" 2>&1; } \
    || { tail -20 "$log" >&2; fail "apt-get could not install ${missing[*]}"; }
  rm -f "$log"
}

make_venv() {
  # One whose interpreter is gone or changed its version is of no use.
  if ! suitable .venv/bin/python || ! .venv/bin/python -m pip --version >/dev/null 2>&1; then
    "$1" -m venv --clear .venv
  fi
}

# uv is several times quicker than pip but reads no pip settings: hand it the machine's index and certificates.
# It compiles only if told to; else each process that may not write bytecode would compile all it imports anew.
install_with_uv() {
  local index
  index=${PIP_INDEX_URL:-$(.venv/bin/pip config get global.index-url 2>/dev/null || true)}
  if [ -n "$index" ]; then export UV_DEFAULT_INDEX=${UV_DEFAULT_INDEX:-$index}; fi
  UV_SYSTEM_CERTS=1 UV_HTTP_TIMEOUT=${UV_HTTP_TIMEOUT:-120} VIRTUAL_ENV=$PWD/.venv \
    .venv/bin/uv pip install --quiet --compile-bytecode --require-hashes -r deploy/locks/dev.txt
}

install_with_pip() {
  say "uv did not succeed; trying pip, which is slower"
  .venv/bin/pip install --quiet --disable-pip-version-check --require-hashes -r deploy/locks/dev.txt
}

wanted=("${system_packages[@]}")
if python=$(find_python); then
  venv=$(venv_package "$python")
  if [ -n "$venv" ]; then wanted+=("$venv"); fi
  mapfile -t -O "${#wanted[@]}" wanted < <(compiler_packages "$python")
else
  [ -z "${PYTHON:-}" ] || fail "PYTHON=$PYTHON is not a Python 3.11, 3.12 or 3.13"
  wanted+=(python3 python3-dev python3-venv g++)
fi
install_system_packages "${wanted[@]}"
python=$(find_python) || fail "no Python 3.11, 3.12 or 3.13 was found: install one, or name it: PYTHON=/path/to/python make setup"

rm -f .venv/.ready
make_venv "$python"
say "installing the locked packages into .venv ($(.venv/bin/python --version))"
.venv/bin/pip install --quiet --disable-pip-version-check --require-hashes -r deploy/locks/setup.txt
install_with_uv || install_with_pip
.venv/bin/pip install --quiet --disable-pip-version-check --no-deps --require-hashes -r deploy/locks/ouster.txt
.venv/bin/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation \
  -e . -e plugins/console -e plugins/fleet -e lab
# The import hook of an editable install would come before PYTHONPATH. Its path file alone does not.
sed -i '/^import /d' .venv/lib/python3.*/site-packages/_editable_skbc_firstfix.pth
touch .venv/.ready
say "the packages are there"

#!/usr/bin/env bash
# Resolves deploy/locks/*.txt from pyproject.toml: pinned, hashed, naming no index, for Python 3.11 and later.
# Arguments go to `uv pip compile` (--upgrade, --upgrade-package NAME).
set -euo pipefail
cd "$(dirname "$0")/../deploy/locks"

compile() {  # OUTPUT SOURCE [OPTION...]
  UV_SYSTEM_CERTS=1 ../../.venv/bin/uv pip compile --quiet --universal --python-version 3.11 \
    --generate-hashes --no-emit-index-url --no-emit-find-links --no-header -o "$@"
  sed -i '/^$/,$d' "$1"  # what was left out, in a last paragraph
}

compile setup.txt setup.in "$@"
packages=(../../pyproject.toml ../../plugins/console/pyproject.toml ../../plugins/fleet/pyproject.toml)
own=(--no-emit-package firstfix)  # which the packages that may be left out need, and whose sources are these
compile dev.txt "${packages[@]}" ../../lab/pyproject.toml --extra dev --extra dds --extra vda5050 "${own[@]}" "$@"
# The images run what was tested: their versions are the tests' ones.
compile service.txt "${packages[@]}" --extra service --extra dds --extra vda5050 --constraints dev.txt "${own[@]}"
compile builder.txt "${packages[@]}" --extra dask --extra dds --extra vda5050 --constraints dev.txt "${own[@]}"  # with builder in it
# ouster-sdk alone: it pins packages that others need newer, and of these it uses none to read recordings.
compile ouster.txt ouster.in --no-deps
# What the tests put beside .venv, as a sourced ROS is: packages that both have are of one version.
compile ros-jazzy.txt ros-jazzy.in --constraints dev.txt
compile ros-kilted.txt ros-kilted.in --constraints dev.txt

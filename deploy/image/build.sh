#!/usr/bin/env bash
# Builds the images firstfix-service and firstfix-builder, tagged with the version and `latest`.
# Arguments go to `docker build`.
#
#   deploy/image/build.sh
#   TARGETS=service DOCKER_BUILDKIT=0 deploy/image/build.sh --network host
set -euo pipefail
cd "$(dirname "$0")/../.."
version=$(sed -n 's/^__version__ = "\(.*\)"/\1/p' core/firstfix/__init__.py)
revision=$(git rev-parse HEAD 2>/dev/null || echo unknown)
# The commit's time, so that the same source gives the same labels.
created=$(git log -1 --format=%cI 2>/dev/null || date -u +%Y-%m-%dT%H:%M:%SZ)
for target in ${TARGETS:-service builder}; do
  docker build "$@" --target "$target" \
    --build-arg VERSION="$version" --build-arg REVISION="$revision" --build-arg CREATED="$created" \
    -t "firstfix-$target:$version" -t "firstfix-$target:latest" . >&2
  docker image ls --no-trunc --format '{{.Repository}}:{{.Tag}}  {{.Size}}  {{.ID}}' "firstfix-$target:latest"
done

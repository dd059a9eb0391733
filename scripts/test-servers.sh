#!/usr/bin/env bash
# Puts versitygw, a real S3 server, beside the tests' Python. Without Go those tests are skipped and say so.
set -euo pipefail
cd "$(dirname "$0")/.."
version=v1.8.0
if [ -x .venv/bin/versitygw ] || command -v versitygw >/dev/null; then exit 0; fi
command -v go >/dev/null || { echo "test-servers: no go here, so the S3 tests will be skipped"; exit 0; }
echo "test-servers: building versitygw $version"
GOBIN=$PWD/.venv/bin go install "github.com/versity/versitygw/cmd/versitygw@$version" \
  || echo "test-servers: versitygw could not be built, so the S3 tests will be skipped"

#!/usr/bin/env bash
# Puts real servers beside the tests' Python: versitygw (S3), nats-server (JetStream), toxiproxy (broken
# networks), haproxy (replicas), Azurite (Azure); and what renders and checks the Helm chart: helm, the schemas of
# Kubernetes and prometheus-operator. Tests whose server or tool cannot be had are skipped and say so.
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

build versitygw github.com/versity/versitygw/cmd/versitygw@v1.8.0
build nats-server github.com/nats-io/nats-server/v2@v2.10.22
build toxiproxy-server github.com/Shopify/toxiproxy/v2/cmd/server@v2.12.0
build helm helm.sh/helm/v3/cmd/helm@v3.19.0

if ! .venv/bin/python -c 'import kubernetes_validate' 2>/dev/null; then
  say "installing the schemas of Kubernetes"
  timeout 300 .venv/bin/pip install --quiet --disable-pip-version-check --no-deps \
    kubernetes-validate==1.37.0 importlib_resources==6.5.2 ||
    say "they could not be installed, so the tests with them will be skipped"
fi

# By folder, not by program: the tests look for .venv/kubernetes-models.
if ! [ -d .venv/kubernetes-models/node_modules ] && command -v npm >/dev/null; then
  say "installing the schemas of prometheus-operator"
  timeout 300 npm install --silent --no-audit --no-fund --prefix .venv/kubernetes-models \
    @kubernetes-models/prometheus-operator@6.0.0 >/dev/null || {
    rm -rf .venv/kubernetes-models
    say "they could not be installed, so the tests with them will be skipped"
  }
fi

# Azurite is a tree of npm packages: it gets a folder, and a link to its program.
if ! [ -x "$bin/azurite-blob" ] && ! command -v azurite-blob >/dev/null; then
  if command -v npm >/dev/null; then
    say "installing azurite"
    rm -rf .venv/azurite
    if timeout 300 npm install --silent --fetch-retries=1 --no-audit --no-fund --prefix .venv/azurite azurite@3.35.0 >/dev/null; then
      ln -sf ../azurite/node_modules/.bin/azurite-blob "$bin/azurite-blob"
    else
      say "azurite could not be installed, so its tests will be skipped"
    fi
  else
    say "no npm here, so the tests with azurite will be skipped"
  fi
fi

if ! command -v haproxy >/dev/null; then
  if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    say "installing haproxy"
    export DEBIAN_FRONTEND=noninteractive
    { apt-get install -y -qq --no-install-recommends haproxy ||
      { apt-get update -qq && apt-get install -y -qq --no-install-recommends haproxy; }; } >/dev/null 2>&1 ||
      say "haproxy could not be installed, so its tests will be skipped"
  else
    say "haproxy is missing and this is not root, so its tests will be skipped"
  fi
fi

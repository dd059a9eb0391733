#!/usr/bin/env bash
# axe-core: a run that is narrowed to a category runs rules that a whole run leaves out.
#
# Version: axe-core 4.14.1 with jsdom 24.1.3 (Node.js 20 or newer).
# Behaviour: color-contrast-enhanced is off by default: axe.run(document) does not run it. With runOnly: ["cat.color"] it runs,
# as every rule of the category does, also the disabled ones. So a page without findings in the whole run (WCAG AA) can have
# findings (AAA) when only its colours are checked, as one does for a second colour scheme. Naming the rules avoids it.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
echo '{"name": "finding", "private": true}' >package.json
npm install --silent --no-audit --no-fund axe-core@4.14.1 jsdom@24.1.3 >/dev/null
cat >run.js <<'JS'
const { JSDOM } = require("jsdom");
const page = "<!doctype html><html lang=en><title>t</title><main><h1>t</h1><p>text</p></main></html>";
const { window } = new JSDOM(page, { runScripts: "outside-only", pretendToBeVisual: true });
window.eval(require("axe-core").source);
const ran = (result) =>
  ["passes", "violations", "incomplete", "inapplicable"].flatMap((kind) => result[kind]).map((rule) => rule.id).sort();
(async () => {
  const whole = ran(await window.axe.run(window.document));
  const colours = ran(await window.axe.run(window.document, { runOnly: ["cat.color"] }));
  console.log(`only by runOnly cat.color: ${colours.filter((rule) => !whole.includes(rule)).join(", ")}`);
})();
JS
said=$(node run.js 2>/dev/null)
echo "$said"
# Output seen:
#   only by runOnly cat.color: color-contrast-enhanced
[ "$said" = "only by runOnly cat.color: color-contrast-enhanced" ] || { echo "the behaviour has changed"; exit 1; }
echo "as described"

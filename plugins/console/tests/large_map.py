"""Measures the browser with a large map: its memory, how soon the points are there, and what a frame costs.

    python -m plugins.console.tests.large_map VERSION --points 50000000 --templates 1000000

VERSION is the folder of a built version; its cloud is replaced by that of a made-up building. Software draws
the picture here, which takes most of a frame, so that a movement is drawn with fewer points; ``script_ms``
is what the console's own code takes of it.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from firstfix.catalog.manifest import Manifest
from firstfix_lab.common.large_cloud import version_with_cloud
from firstfix_lab.common.memory import descendants, pss_of_family
from plugins.console.tests.browser import HOST, Browser, running_browser
from plugins.console.tests.page import CANVAS, Page
from tests.service.service_world import running_service
from tests.waiting import let_pass

MAP = "campus"
MIB = 1 << 20
LOOK_S = 0.5
FRAMES = 40  # with software the first one takes more than a second
# Notes how long the page's callbacks before a frame take. With software they return before it is drawn.
PROFILE = """
globalThis.frames = [];
const ask = globalThis.requestAnimationFrame.bind(globalThis);
globalThis.requestAnimationFrame = (then) => ask((at) => {
  const began = performance.now();
  then(at);
  frames.push({ at, took: performance.now() - began });
});
"""
# Drags the map to and fro by the mouse, as a person does, as fast as frames come.
PAN = f"""
(async () => {{
  const canvas = document.querySelector('{CANVAS} canvas');
  const box = canvas.getBoundingClientRect();
  const tell = (type, x) => canvas.ownerDocument.defaultView && canvas.dispatchEvent(new PointerEvent(type, {{
    pointerId: 1, bubbles: true, button: type === 'pointermove' ? -1 : 0, buttons: 1, pointerType: 'mouse',
    clientX: box.x + x, clientY: box.y + box.height / 2 }}));
  canvas.setPointerCapture = canvas.releasePointerCapture = () => {{}};
  frames.length = 0;
  tell('pointerdown', 300);
  const began = performance.now();
  for (let i = 0; i < {FRAMES}; i++) {{
    tell('pointermove', 300 + 2 * (i < {FRAMES} / 2 ? i : {FRAMES} - i));
    await new Promise((drawn) => requestAnimationFrame(drawn));
  }}
  const seconds = (performance.now() - began) / 1000;
  tell('pointerup', 300);
  const took = frames.map((one) => one.took).filter((ms) => ms > 0.05).sort((a, b) => a - b);
  return {{ frames_a_second: {FRAMES} / seconds, script_ms_p50: took[took.length >> 1],
    script_ms_p95: took[Math.floor(0.95 * took.length)] }};
}})()
"""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("version", type=Path)
    parser.add_argument("--points", type=int, default=5_000_000)
    parser.add_argument("--templates", type=int, default=1_000_000)
    parser.add_argument("--layers", default="trajectory,templates")
    parser.add_argument(
        "--keep", type=Path, help="folder of the version with the cloud, made where it is missing"
    )
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drawn = chosen.keep or folder / "drawn"
        if not drawn.exists():
            version_with_cloud(chosen.version, drawn, chosen.points, chosen.templates)
        with (
            running_service(folder, load=None, zenoh=False) as service,
            running_browser(folder / "browser") as browser,
        ):
            service.catalog.publish(MAP, drawn, Manifest.for_directory(drawn))
            origin = f"http://{HOST}:{service.url.rpartition(':')[2]}"
            with browser.page(origin, is_first_visit=True) as page:
                print(json.dumps(measured(browser, page, chosen.layers), indent=2))
                page.map_picture()


def measured(browser: Browser, page: Page, layers: str) -> dict[str, Any]:
    """Figures of one look at the map."""
    page.call("Page.addScriptToEvaluateOnNewDocument", source=PROFILE)
    page.open()
    page.wait("a", MAP)
    let_pass(1)  # what was begun is over
    found: dict[str, Any] = {"memory_before_mib": memory(browser, page)}
    page.open(f"#/maps/{MAP}?layers={layers}")
    peak, first_s, shown = 0, 0.0, 0
    while page.js(f"document.querySelector('{CANVAS}')?.getAttribute('aria-busy') !== 'false'"):
        shown = int(page.js(f"document.querySelector('{CANVAS}')?.dataset.points ?? 0"))
        if shown and not first_s:
            first_s = float(page.js("performance.now()")) / 1000
        peak = max(peak, pss_of_family(browser.pid))
    all_s = float(page.js("performance.now()")) / 1000
    found["points_shown"] = int(page.js(f"document.querySelector('{CANVAS}').dataset.points"))
    found["first_points_s"], found["all_points_s"] = round(first_s, 2), round(all_s, 2)
    found["peak_mib"] = round(peak / MIB)
    let_pass(LOOK_S)  # what was begun is over
    found["memory_open_mib"] = memory(browser, page)
    found["panning"] = page.js(PAN)
    found["memory_panned_mib"] = memory(browser, page)
    return found


def memory(browser: Browser, page: Page) -> dict[str, int]:
    """MiB of the page's scripts with their buffers, of the page's process, and of all the browser's."""
    usage = page.call("Runtime.getHeapUsage")
    heap = usage["usedSize"] + usage.get("backingStorageSize", 0)
    pages = [pss_of_family(pid) for pid in descendants(browser.pid) if is_page(pid)]
    found = {"script": heap, "page": max(pages), "all_processes": pss_of_family(browser.pid)}
    return {name: round(size / MIB) for name, size in found.items()}


def is_page(pid: int) -> bool:
    """Returns whether a process of the browser runs pages."""
    return b"--type=renderer" in Path(f"/proc/{pid}/cmdline").read_bytes()


if __name__ == "__main__":
    main()

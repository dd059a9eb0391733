"""Measures what frames of a large map cost in processor time, with this page and with another one, in turn.

    python -m plugins.console.tests.frame_cost VERSION --against FOLDER --points 2000000

VERSION is the folder of a built version; its cloud is replaced by that of a made-up building. FOLDER has the
files of the other page, such as that of an older commit: what `vite build` made. Software draws the picture
here. So a movement is drawn with fewer points, by a pace that each page learns from its frames; a picture
at rest has the same points in both.
"""

from __future__ import annotations

import argparse
import json
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from firstfix.catalog.manifest import Manifest
from firstfix_console import page as page_of_console
from firstfix_lab.common.large_cloud import version_with_cloud
from firstfix_lab.common.processor_time import cpu_s_of_family
from plugins.console.tests.browser import HOST, Browser, running_browser
from plugins.console.tests.large_map import FRAMES, MAP, PAN, PROFILE
from plugins.console.tests.page import CANVAS, Page
from tests.service.service_world import running_service

PICTURES = 6
TEMPLATES = 3000
IS_AT_REST = f"document.querySelector('{CANVAS}')?.getAttribute('aria-busy') === 'false'"
POINTS = f"Number(document.querySelector('{CANVAS}').dataset.points)"
Figures = dict[str, float]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("version", type=Path)
    parser.add_argument("--against", type=Path, required=True)
    parser.add_argument("--points", type=int, default=2_000_000)
    parser.add_argument("--rounds", type=int, default=3)
    chosen = parser.parse_args()
    pages = {"this": page_of_console.FILES, "other": chosen.against}
    found: dict[str, list[Figures]] = {name: [] for name in pages}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drawn = folder / "drawn"
        version_with_cloud(chosen.version, drawn, chosen.points, TEMPLATES)
        with (
            running_service(folder, load=None, zenoh=False) as service,
            running_browser(folder / "browser") as browser,
        ):
            service.catalog.publish(MAP, drawn, Manifest.for_directory(drawn))
            origin = f"http://{HOST}:{service.url.rpartition(':')[2]}"
            for _ in range(chosen.rounds):
                for name, files in pages.items():
                    with served(files), browser.page(origin, is_first_visit=True) as page:
                        found[name].append(measured(browser, page))
                        print(name, json.dumps(found[name][-1]), flush=True)
    medians = {name: _medians(rounds) for name, rounds in found.items()}
    ratios = {
        name: round(medians["this"][name] / other, 3) for name, other in medians["other"].items() if other
    }
    print(json.dumps({**medians, "this / other": ratios}, indent=2))


@contextmanager
def served(files: Path) -> Iterator[None]:
    """Has the service of this process give the files of a page."""
    own = page_of_console.FILES
    page_of_console.FILES = files
    page_of_console.page_files.cache_clear()
    yield
    page_of_console.FILES = own


def measured(browser: Browser, page: Page) -> Figures:
    """Figures of one look at the map. Times are those of all the browser's processes."""
    page.call("Page.addScriptToEvaluateOnNewDocument", source=PROFILE)
    page.open(f"#/maps/{MAP}")
    page.until(f"{IS_AT_REST} && {POINTS} > 0")
    page.js(PAN)  # its pace is learnt
    page.until(IS_AT_REST)
    before_s = cpu_s_of_family(browser.pid)
    panned = page.js(
        PAN.replace("tell('pointerup'", f"const points = {POINTS}; tell('pointerup'").replace(
            "return {", "return { points,"
        )
    )
    moving_s = cpu_s_of_family(browser.pid) - before_s
    page.until(IS_AT_REST)
    page.js(f"document.querySelector('{CANVAS} canvas').focus()")
    before_s = cpu_s_of_family(browser.pid)
    for number in range(PICTURES):
        page.press("ArrowRight" if number % 2 else "ArrowLeft")
        page.js("new Promise((drawn) => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
        page.until(IS_AT_REST)
    return {
        "moving_frames_a_second": round(panned["frames_a_second"], 1),
        "moving_processor_ms": round(1000 * moving_s / FRAMES, 1),
        "moving_points": panned["points"],
        "moving_script_ms": round(panned["script_ms_p50"], 2),
        "moved_picture_processor_ms": round(1000 * (cpu_s_of_family(browser.pid) - before_s) / PICTURES, 1),
        "picture_points": page.js(POINTS),
    }


def _medians(rounds: list[Figures]) -> Figures:
    return {name: statistics.median(one[name] for one in rounds) for name in rounds[0]}


if __name__ == "__main__":
    main()

"""Times the first view of the console, of the start page and of a map, on a slow machine or over a thin line.

python -m plugins.console.tests.first_view demo/store factory --slowed 4
python -m plugins.console.tests.first_view demo/store factory --mbit 10 --latency-ms 20

The service has loaded its versions by then, and the browser keeps no file from one round to the next.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path
from statistics import median

import httpx

from plugins.console.tests.browser import HOST, Browser, running_browser
from plugins.console.tests.page import CANVAS, Page
from tests.service.service_world import running_service
from tests.waiting import wait_until

LOOK = "const look = () => {shown} ? there(performance.now()) : setTimeout(look, 10);"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("map_id")
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--slowed", type=float, default=1.0, help="how many times slower the processor is")
    parser.add_argument("--mbit", type=float, help="of the line, in a second; not given: as it is")
    parser.add_argument("--latency-ms", type=float, default=0.0)
    chosen = parser.parse_args()
    views = {
        "": f"!!find('a', '{chosen.map_id}')",
        f"#/maps/{chosen.map_id}": f"document.querySelector('{CANVAS}')?.dataset.points > 0",
    }
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(chosen.store, folder / "store")
        with (
            running_service(folder, load=None, zenoh=False) as service,
            running_browser(folder / "browser") as browser,
        ):
            origin = f"http://{HOST}:{service.url.rpartition(':')[2]}"
            wait_until(lambda: httpx.get(f"{service.url}/readyz").is_success)
            for view, shown in views.items():
                first_s = [first_view_s(browser, origin, view, shown, chosen) for _ in range(chosen.rounds)]
                rounds = ", ".join(f"{seconds:.2f}" for seconds in first_s)
                print(f"{view or 'start page'}: {median(first_s):.2f} s at the median of {rounds}")


def first_view_s(browser: Browser, origin: str, view: str, shown: str, chosen: argparse.Namespace) -> float:
    """Returns the seconds from the page's request until the view is there, by the browser's own clock."""
    with browser.page(origin, is_first_visit=True) as page:
        page.call("Network.setCacheDisabled", cacheDisabled=True)
        page.call("Emulation.setCPUThrottlingRate", rate=chosen.slowed)
        if chosen.mbit:
            thin(page, chosen.mbit, chosen.latency_ms)
        page.open(view)
        return float(page.js(f"new Promise((there) => {{ {LOOK.format(shown=shown)} look(); }})")) / 1000


def thin(page: Page, mbit: float, latency_ms: float) -> None:
    """Gives the page a line of so many megabits a second in both directions."""
    bytes_per_s = mbit * 1e6 / 8
    page.call(
        "Network.emulateNetworkConditions",
        offline=False,
        latency=latency_ms,
        downloadThroughput=bytes_per_s,
        uploadThroughput=bytes_per_s,
    )


if __name__ == "__main__":
    main()

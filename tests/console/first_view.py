"""Times the first view of the console over a thin line: to the list of maps, and to a map.

python tests/console/first_view.py demo/store factory --mbit 10 --latency-ms 20
"""

from __future__ import annotations

import argparse
import shutil
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path += [str(HERE.parent), str(HERE.parent / "service")]

from browser import HOST, running_browser  # noqa: E402
from page import CANVAS, Page  # noqa: E402
from service_world import running_service  # noqa: E402


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("map_id")
    parser.add_argument("--mbit", type=float, default=10.0, help="of the line, in a second")
    parser.add_argument("--latency-ms", type=float, default=20.0)
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(chosen.store, folder / "store")
        with (
            running_service(folder, load=None, zenoh=False) as service,
            running_browser(folder / "browser") as browser,
        ):
            origin = f"http://{HOST}:{service.url.rpartition(':')[2]}"
            for view, shown in (
                ("", f"!!find('a', '{chosen.map_id}')"),
                (f"#/maps/{chosen.map_id}", f"document.querySelector('{CANVAS}')?.dataset.points > 0"),
            ):
                with browser.page(origin) as page:
                    thin(page, chosen.mbit, chosen.latency_ms)
                    page.open(view)
                    page.until(shown)
                    first_s = since_begun(page)
                    if view:
                        page.map_picture()
                    print(f"{view or 'list'}: {first_s:.2f} s, all of it {since_begun(page):.2f} s")


def since_begun(page: Page) -> float:
    """Returns the seconds since the page was asked for, by the browser's own clock."""
    return float(page.js("performance.now()")) / 1000


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

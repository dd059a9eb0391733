"""Makes the documentation's pictures of the console, from maps of a store and scans of one of them.

    python -m plugins.console.tests.screenshots demo/store demo/factory/poses.csv docs/images

The store is copied, so nothing in it changes.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path

import httpx
import numpy as np
from PIL import Image

from firstfix.decode import read_scan_file
from firstfix.wire.scan import MEDIA_TYPE, encode_scan
from firstfix_cli.poses_csv import read_poses_csv
from plugins.console.tests.browser import HOST, running_browser
from plugins.console.tests.page import Page
from tests.service.service_world import running_service

COLOURS = (256, 192, 128, 96, 64)  # of a palette: as many as the size allows
MAX_BYTES = 195_000


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("store", type=Path)
    parser.add_argument("poses", type=Path, help="poses.csv beside the scans; its folder names their map")
    parser.add_argument("images", type=Path)
    parser.add_argument("--view", default="", help="camera of the map's picture, as in the console's address")
    chosen = parser.parse_args()
    map_id = chosen.poses.parent.name
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        shutil.copytree(chosen.store, folder / "store")
        shutil.rmtree(folder / "store/recorded-queries", ignore_errors=True)
        with (
            running_service(
                folder, load=None, zenoh=False, recorded_share=1.0, recorded_share_localized=1.0
            ) as service,
            running_browser(folder / "browser") as browser,
        ):
            origin = f"http://{HOST}:{service.url.rpartition(':')[2]}"
            rows = [row for row in read_poses_csv(chosen.poses) if row.T_map_sensor is not None]
            middle = np.median([row.T_map_sensor[:3, 3] for row in rows], axis=0)
            rows.sort(key=lambda row: float(np.linalg.norm(row.T_map_sensor[:3, 3] - middle)))
            scans = []
            for row in rows[:40]:
                file = folder / f"{row.path.stem}.ffscan"
                file.write_bytes(encode_scan(read_scan_file(row.path)))
                scans.append(file)
            with browser.page(origin) as page:
                page.size(1280, 780)
                page.prefers("dark")
                take(page, service.http, map_id, scans, chosen.images, chosen.view)


def take(page: Page, http: httpx.Client, map_id: str, scans: list[Path], images: Path, view: str) -> None:
    """Goes through the views and keeps a picture of each."""
    answers = {file: ask(http, map_id, file) for file in scans}
    maps = [one["map_id"] for one in http.get("/maps").json()["maps"]]
    versions = {one: len(http.get(f"/maps/{one}/versions").json()["versions"]) for one in maps}
    page.open()
    page.wait("td", "%")
    keep(page, images / "console-maps.png")

    page.open(f"#/maps/{map_id}?layers=trajectory,templates" + (f"&view={view}" if view else ""))
    page.map_picture()
    keep(page, images / "console-map.png")

    page.open(f"#/maps/{map_id}/try")
    page.map_picture()
    page.drop(".panel .drop", next(file for file in scans if answers[file] == "localized"))
    page.wait(".key", "on the map")
    page.map_picture()
    keep(page, images / "console-scan.png")

    page.open(f"#/maps/{max(versions, key=lambda one: versions[one])}/versions")
    page.wait("input[type=checkbox]")
    for number in (1, 2):
        page.click(f"tr:nth-child({number}) input[type=checkbox]")
    page.wait("[aria-label=Comparison] td")
    keep(page, images / "console-versions.png")

    page.open(f"#/live?map={map_id}")
    page.map_picture()
    rows = page.count(".fixes tbody tr")
    for file in scans[:20]:
        ask(http, map_id, file)
    page.until(f"document.querySelectorAll('.fixes tbody tr').length >= Math.min(30, {rows} + 20)")
    page.map_picture()
    keep(page, images / "console-live.png")

    page.open("#/recorded-queries")
    page.choose("Map", map_id)
    page.wait("td .verdict")
    keep(page, images / "console-recorded-queries.png")


def ask(http: httpx.Client, map_id: str, scan: Path) -> str:
    answer = http.post(
        "/localize", params={"map": map_id}, content=scan.read_bytes(), headers={"Content-Type": MEDIA_TYPE}
    )
    return str(answer.raise_for_status().json()["verdict"])


def keep(page: Page, file: Path) -> None:
    """Writes what is seen, without the empty rows at the end of a list."""
    bottom = page.js(
        "Math.max(0, ...[...document.querySelectorAll('.page *')].map((e) =>"
        " e.getBoundingClientRect().bottom))"
    )
    picture = page.picture()
    shown = Image.fromarray(picture[: int(bottom) + 24] if bottom else picture)
    for colours in COLOURS:
        shown.quantize(colours, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
            file, optimize=True
        )
        if file.stat().st_size <= MAX_BYTES:
            break
    print(f"{file}: {file.stat().st_size / 1000:.0f} KB")


if __name__ == "__main__":
    main()

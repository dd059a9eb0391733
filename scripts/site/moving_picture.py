"""Draws the moving picture of the README from what ``make demo`` left.

    python scripts/site/moving_picture.py demo docs/demo.webp

Each scan is localized anew, in this process, with the version in the demo's store. It appears as the robot
sends it, then at the pose that was answered. The last scan was taken in another place and gets no pose.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from firstfix_cli.evaluate import Outcome, outcome_of
from firstfix_cli.plot import RIGHT, MapPicture
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from firstfix.answer.options import LocalizeOptions
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import transform_points
from firstfix_cli.answerer import answerer, fetch_active_version
from firstfix_cli.poses_csv import PosedScan, read_poses_csv

WORLD = "factory"
OWN, FOREIGN = 8, 1  # scans of the hall, and of other places
ASK_MS, ANSWER_MS, LAST_MS = 700, 1300, 2500
SIZE_INCHES, DPI = (10.0, 5.0), 80
QUALITY = 60  # of WebP
MAX_SCAN_POINTS = 6000
SENT, NO_POSE, QUIET = "#4575b4", "#d73027", "#9aa0a6"


def chosen(rows: list[PosedScan]) -> list[PosedScan]:
    own = [row for row in rows if row.T_map_sensor is not None]
    foreign = [row for row in rows if row.T_map_sensor is None]
    return [own[row] for row in rows_by_chance(len(own), OWN)] + foreign[:FOREIGN]


def localized(demo: Path) -> list[tuple[Scan, Outcome]]:
    """The scans and their answers. The first one is asked twice, so that its time is not that of loading."""
    found = []
    with answerer(WORLD, url=None, zenoh=None, store=str(demo / "store"), timeout_s=30.0) as ask:
        rows = chosen(read_poses_csv(demo / WORLD / "poses.csv"))
        ask(read_scan_file(rows[0].path), LocalizeOptions())
        for row in rows:
            scan = read_scan_file(row.path)
            begin = time.perf_counter()
            answer = ask(scan, LocalizeOptions())
            ms = (time.perf_counter() - begin) * 1e3
            found.append((scan, outcome_of(row.path.name, row.T_map_sensor, answer, ms)))
    return found


def frames(picture: MapPicture, answers: list[tuple[Scan, Outcome]]) -> Iterator[tuple[Image.Image, int]]:
    """Pictures with the milliseconds that each is shown."""
    low, high = picture.points[:, :2].min(axis=0), picture.points[:, :2].max(axis=0)
    for number, (scan, outcome) in enumerate(answers):
        before = [one for _, one in answers[:number]]
        last = number == len(answers) - 1
        for answered in (False, True):
            figure = Figure(figsize=SIZE_INCHES, dpi=DPI)
            FigureCanvasAgg(figure)
            ground = figure.add_axes((0.01, 0.02, 0.68, 0.96), xlim=(low[0], high[0]), ylim=(low[1], high[1]))
            sent = figure.add_axes((0.71, 0.34, 0.28, 0.56))
            for axes in (ground, sent):
                axes.set_aspect("equal")
                axes.set_axis_off()
            _draw_map(ground, picture)
            for one in before:
                _draw_pose(ground, one, 5)
            _draw_sent(sent, scan)
            if answered:
                _draw_placed(ground, scan, outcome)
            _say(figure, outcome, answered)
            yield _drawn(figure), (LAST_MS if last else ANSWER_MS) if answered else ASK_MS


def _draw_map(axes: Any, picture: MapPicture) -> None:
    shown = picture.below_ceilings()
    shown = shown[rows_by_chance(len(shown), 120_000)]
    axes.scatter(*shown[:, :2].T, c=shown[:, 2], s=0.6, cmap="Greys", vmin=-0.6, vmax=2.6, lw=0)


def _draw_sent(axes: Any, scan: Scan) -> None:
    near = scan.points[np.linalg.norm(scan.points[:, :2], axis=1) < 20.0]
    near = near[rows_by_chance(len(near), MAX_SCAN_POINTS)]
    axes.scatter(*near[:, :2].T, s=0.8, c=SENT, lw=0)
    axes.plot(0, 0, "o", ms=6, c="black", mec="white")
    axes.set_xlim(-20, 20)
    axes.set_ylim(-20, 20)


def _draw_placed(axes: Any, scan: Scan, outcome: Outcome) -> None:
    pose = outcome.answer.T_map_sensor
    if pose is None:
        return
    points = transform_points(pose, scan.points[rows_by_chance(len(scan), MAX_SCAN_POINTS)])
    axes.scatter(*points[:, :2].T, s=1.2, c=SENT, lw=0, alpha=0.7)
    _draw_pose(axes, outcome, 9)


def _draw_pose(axes: Any, outcome: Outcome, size: int) -> None:
    pose = outcome.answer.T_map_sensor
    if pose is None:
        return
    start, ahead = pose[:2, 3], pose[:2, 0]
    axes.plot(*np.stack([start, start + 0.22 * size * ahead]).T, "-", c=RIGHT, lw=0.25 * size)
    axes.plot(*start, "o", ms=size, c=RIGHT, mec="white")


def _say(figure: Figure, outcome: Outcome, answered: bool) -> None:
    figure.text(0.85, 0.93, "the robot sends one scan", ha="center", fontsize=13)
    if not answered:
        figure.text(0.85, 0.25, "where is it?", ha="center", fontsize=15, color=QUIET)
        return
    verdict = outcome.answer.verdict.value
    placed = outcome.answer.T_map_sensor is not None
    colour = RIGHT if placed else NO_POSE
    figure.text(0.85, 0.25, verdict, ha="center", fontsize=17, color=colour, weight="bold")
    if placed:
        lines = (f"{outcome.error_m * 100:.1f} cm off the truth", f"in {outcome.ms:.0f} ms")
    else:
        lines = ("taken in another place:", "no pose")
    for row, line in enumerate(lines):
        figure.text(0.85, 0.17 - 0.08 * row, line, ha="center", fontsize=13)


def _drawn(figure: Figure) -> Image.Image:
    written = io.BytesIO()
    figure.savefig(written, format="png")
    return Image.open(written).convert("RGB")


def main(demo: Path, path: Path) -> None:
    folder = fetch_active_version(str(demo / "store"), WORLD, None)[1]
    drawn, shown_ms = zip(*frames(MapPicture.load(folder), localized(demo)), strict=True)
    first, *others = drawn
    first.save(
        path, save_all=True, append_images=others, duration=shown_ms, loop=0, quality=QUALITY, method=6
    )
    print(f"{path}: {len(drawn)} pictures, {path.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))

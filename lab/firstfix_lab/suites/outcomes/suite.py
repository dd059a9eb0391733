"""Outcomes of natural scans in many maps: the table that ships with the release, and what it shows.

    firstfix-lab outcomes strangers        # the scans of strange places that every self-test asks
    firstfix-lab outcomes table            # the table, of all maps that are beside the checkout
    firstfix-lab outcomes show             # figures of the table, each map judged by the others

Each of ``MAPS`` is built as a user would build it. Then it is asked natural scans: real ones, and simulated
ones whose disturbances are not those of the self-test, in the map and of other places. The table keeps of
each answer what was claimed and whether it was right, and no cloud.
"""

from __future__ import annotations

import csv
import gzip
import io
import os
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from firstfix_builder.self_test.taught_outcomes import COLUMNS
from firstfix_lab.checkout import BENCH

from .ask import Asked, Sizes, outcomes_of
from .maps import MAPS, TaughtMap

WORK = BENCH / "outcomes"
_QUALITY = (
    "inlier_ratio",
    "alignment_score",
    "free_space_violation",
    "removed_surface",
    "beside_surface",
    "same_plane",
    "seen_free",
)
_HEADER = (*COLUMNS, "case", *_QUALITY)


def measure(names: Sequence[str], work: Path, processes: int) -> None:
    """Ask the maps of these names, some at a time, and keep a part of the table for each."""
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        running = [pool.submit(measure_map, name, work) for name in names]
        for one in running:
            one.result()


def measure_map(name: str, work: Path) -> None:
    """Ask one map. Its part of the table is ``NAME.csv``."""
    (one,) = (each for each in MAPS if each.name == name)
    began = time.process_time()
    folder = work / name
    folder.mkdir(parents=True, exist_ok=True)
    rows = [_row(one, asked) for asked in outcomes_of(one, Sizes(), folder)]
    with (work / f"{name}.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)
    print(f"{name}: {len(rows)} answers, {time.process_time() - began:.0f} s", file=sys.stderr, flush=True)


def write_table(work: Path, path: Path) -> int:
    """Put the parts together, and return the number of answers. Equal parts give equal bytes."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_HEADER)
    count = 0
    for one in MAPS:
        part = work / f"{one.name}.csv"
        if part.exists():
            lines = part.read_text()
            text.write(lines)
            count += lines.count("\n")
    path.write_bytes(gzip.compress(text.getvalue().encode(), mtime=0))
    return count


def available() -> list[str]:
    """Names of the maps that are beside the checkout; what is missing is told."""
    for one in MAPS:
        if one.missing is not None:
            print(f"{one.name}: left out, {one.missing}", file=sys.stderr)
    return [one.name for one in MAPS if one.missing is None]


def _row(one: TaughtMap, asked: Asked) -> list[str]:
    qualities = ["" if asked.quality is None else _number(getattr(asked.quality, name)) for name in _QUALITY]
    told = [
        f"{asked.own_threshold:.6f}",
        asked.kind,
        f"{asked.claimed:.6f}",
        str(int(asked.right)),
        asked.case,
    ]
    return [one.name, one.place, asked.sensor, *told, *qualities]


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.4f}"


def processes() -> int:
    """Map that are asked at a time."""
    return os.cpu_count() or 1

"""Held-out scans asked in this process, in every variant."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from pathlib import Path

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.localizer import Localizer
from firstfix.scan_file import read_scan_file
from firstfix_cli.poses_csv import read_poses_csv
from tests.recorded_data import Dataset

from ...common.asked import Asked
from ...evaluation.pose_gravity import gravity_at, imu_errors
from .variants import variants

GRAVITY: Mapping[str, float | None] = {"estimated": None, "given": 1.0}  # degrees of noise, as of an IMU


def ask(dataset: Dataset, localizer: Localizer, work: Path) -> Iterator[Asked]:
    """Ask every held-out scan in every variant, by each source of gravity.

    Args:
        work: an existing folder.
    """
    tables = {
        reference: read_poses_csv(dataset.write_queries(work / "truth.csv", reference))
        for reference in dataset.references
    }
    errors = {name: imu_errors(len(next(iter(tables.values()))), noise) for name, noise in GRAVITY.items()}
    for number, rows in enumerate(zip(*tables.values(), strict=True)):
        scan = read_scan_file(rows[0].path)
        truth = {name: row.T_map_sensor for name, row in zip(tables, rows, strict=True)}
        for variant, worse, T_scan_sensor in variants(dataset, scan, number):
            true = {name: T @ T_scan_sensor for name, T in truth.items() if T is not None}
            for gravity, error_rad in errors.items():
                off_rad = error_rad[number]
                down = None if off_rad is None else gravity_at(next(iter(true.values())), off_rad)
                began = time.perf_counter()
                answer = localizer.localize(worse, LocalizeOptions(gravity=down))
                ms = 1e3 * (time.perf_counter() - began)
                yield Asked(rows[0].path.name, variant, gravity, true, answer, ms)

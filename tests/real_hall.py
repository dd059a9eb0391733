"""The real hall beside the checkout: a version of it, built once a run, and its held-out scans."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.needs import of_recordings
from tests.once_a_run import OnceARun
from tests.recorded_data import HALL


@pytest.fixture(scope="session")
def hall_directory(once_a_run: OnceARun) -> Path:
    """The folder of a version, with fewer templates, scans and queries than usual: others test the engine."""
    if not HALL.available:
        pytest.skip(of_recordings("hilti_hall_indoor"))
    config = {
        **HALL.config,
        "viewpoints": {"spacing_m": 2.0, "max_distance_to_trajectory_m": 3.0},
        "learn_keys": {"scans": 0},
        "self_test": {"queries": 20, "outside": 10},
    }

    def build(folder: Path) -> None:
        from firstfix.builds.config import BuildConfig
        from firstfix_builder.pipeline import build_version

        trajectory = HALL.write_trajectory(folder / "trajectory.csv")
        build_version(HALL.map_path, BuildConfig.parse(config), folder, trajectory=trajectory)

    return once_a_run.folder("real-hall", build) / "version"

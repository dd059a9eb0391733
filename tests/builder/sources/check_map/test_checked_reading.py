"""Poses that a build keeps after the check has judged them, and marks in the report's picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.builds.config import BuildConfig
from firstfix_builder.self_test.localizability import draw_localizability
from firstfix_builder.sources.read_map import MapData
from firstfix_builder.sources.write_level_map import write_level_map
from firstfix_builder.stage_results import LevelMap
from tests.builder.sources.check_map.even_hall import SENSOR_M, hall, posed, way

FAR_M = np.array([450_000.0, 5_200_000.0, 0.0])


def level_map(
    folder: Path, poses: np.ndarray, source: str = "given", mount_height_m: float = 0.0
) -> LevelMap:
    """The hall with UTM-sized coordinates and these poses, read for a build."""
    moved = poses.copy()
    moved[:, :3, 3] += FAR_M
    data = MapData(points=hall() + FAR_M, trajectory=moved, trajectory_source=source)
    config = BuildConfig.parse({"level": False, "trajectory_mount_height_m": mount_height_m})
    folder.mkdir()
    write_level_map(folder / "hall", None, config, folder, read=lambda path: data)
    return LevelMap("", folder, "")


def test_a_mount_height_lifts_the_poses_of_a_build(tmp_path: Path):
    low = level_map(tmp_path / "low", posed(way(0.0)))
    assert [one["code"] for one in low.findings] == ["trajectory_of_base"]
    lifted = level_map(tmp_path / "lifted", posed(way(0.0)), mount_height_m=SENSOR_M)
    assert lifted.findings == []
    assert lifted.trajectory is not None
    assert low.trajectory is not None
    np.testing.assert_allclose(lifted.trajectory[:, 2, 3] - low.trajectory[:, 2, 3], SENSOR_M)


def test_poses_of_the_map_itself_that_are_elsewhere_are_left_out_of_the_build(tmp_path: Path):
    found = level_map(tmp_path / "map", posed(way() + [0, 300, 0]), "file")
    assert [one["code"] for one in found.findings] == ["trajectory_left_out"]
    assert found.trajectory is None


def test_places_of_findings_are_marked_where_they_are_in_the_picture(tmp_path: Path):
    leaning = posed(way() + np.column_stack([np.zeros((120, 2)), 0.1 * (way()[:, 0] - 15)]))
    found = level_map(tmp_path / "map", leaning)
    marked = found.marked_places
    assert list(marked) == ["trajectory_leans"]
    assert marked["trajectory_leans"][:, 0] == pytest.approx([2, 28], abs=0.1), "in the level frame"
    points = np.asarray(found.points)
    draw_localizability(points, [], tmp_path / "none.png")
    draw_localizability(points, [], tmp_path / "marked.png", marked=marked)
    assert (tmp_path / "marked.png").read_bytes() != (tmp_path / "none.png").read_bytes()

"""The stage that draws the cloud for viewers: of meshes, clouds and sessions, wherever it runs."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from firstfix.builds.config import BuildConfig
from firstfix.catalog.manifest import CLOUD_INDEX, CLOUD_INTENSITY, CLOUD_POINTS
from firstfix.catalog.viewer_cloud import NO_NORMAL, POINT
from firstfix.engine.index import MAP_FILE
from firstfix.transform import make_transform, rotation_angle_deg, transform_points
from firstfix_builder.execution.stage_cache import StageResult
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.pipeline import build_version
from firstfix_builder.stage_results import IndexFiles, LevelMap
from tests.builder.stages import stages_below
from tests.small_world import COARSE_CONFIG, SmallWorld, begun_as

pytestmark = pytest.mark.slow
THINNED_M = 0.1  # the first stage of a build puts means in the place of near points


class Stages:
    """The stages ``read_map`` and ``draw_cloud`` in a work folder, over the index of a built version."""

    def __init__(self, built: BuildResult, work: Path) -> None:
        self.work = begun_as(built, work)
        index = json.loads((built.directory / "manifest.json").read_text())["files"]["keys.faiss"]["sha256"]
        self.index = next(
            IndexFiles(stage.parent.name, stage.parent / "files", index)
            for stage in self.work.glob("stages/*/stage.json")
            if json.loads(stage.read_text())["stage"] == "build_index"
        )
        self.drawn = 0

    def draw(self, source: Path, config: BuildConfig | None = None) -> tuple[LevelMap, StageResult]:
        """The results of reading a source and of drawing it."""

        def count(stage: str, fraction: float) -> None:
            self.drawn += (stage, fraction) == ("draw_cloud", 0.0)

        with stages_below(self.work, config, count) as stages:
            read = stages.read_map(source, None)
            return read, stages.draw_cloud(read, self.index)


@pytest.fixture
def stages(coarse_version: BuildResult, tmp_path: Path) -> Callable[[str], Stages]:
    return lambda name: Stages(coarse_version, tmp_path / name)


def points_on(world: SmallWorld, count: int, seed: int = 2) -> np.ndarray:
    rng = np.random.default_rng(seed)
    corner = world.vertices[world.triangles]  # (t, 3, 3)
    area = np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    of = corner[rng.choice(len(corner), count, p=area / area.sum())]
    return np.einsum("nij,ni->nj", of, rng.dirichlet(np.ones(3), len(of)))


def cloud_of(directory: Path) -> tuple[dict, np.ndarray, np.ndarray]:
    """The index, the (n, 3) positions and the (n, 2) normals of the nodes."""
    index = json.loads((directory / CLOUD_INDEX).read_text())
    packed = np.fromfile(directory / CLOUD_POINTS, POINT)
    found = []
    for level, *cell, first, count in index["nodes"]:
        edge_m = index["edge_m"] / 2**level
        at = packed[first : first + count]["at"] / 65535
        found.append(np.array(index["low_m"]) + (np.array(cell) + at) * edge_m)
    return index, np.concatenate(found), packed["normal"][: index["points"]]


def mark_of(directory: Path, name: str) -> np.ndarray:
    index = json.loads((directory / CLOUD_INDEX).read_text())
    first, count = index["marks"][name]
    packed = np.fromfile(directory / CLOUD_POINTS, POINT)[first : first + count]
    return np.array(index["low_m"]) + packed["at"] * (index["edge_m"] / 65535)


def far_apart(some: np.ndarray, others: np.ndarray) -> float:
    """Largest distance from one of some points to the nearest of the others, metres."""
    return float(KDTree(others).query(some)[0].max())


def the_same(found: np.ndarray, expected: np.ndarray) -> None:
    """Both hold the same points, whatever their order."""
    assert len(found) == len(expected)
    assert far_apart(found, expected) < 2e-3
    assert far_apart(expected, found) < 2e-3


def test_of_a_mesh_the_points_that_are_seen_are_drawn(coarse_version: BuildResult, small_world: SmallWorld):
    index, points, normals = cloud_of(coarse_version.directory)
    seen = np.load(coarse_version.directory / MAP_FILE)
    origin = np.array(coarse_version.manifest.origin)
    the_same(points, seen[:, :3] + origin)
    np.testing.assert_allclose(
        mark_of(coarse_version.directory, "templates"),
        np.load(coarse_version.directory / "template_position_m.npy") + origin,
        atol=2e-3,
    )
    assert index["marks"]["trajectory"][1] == 0
    assert np.mean(normals[:, 0] == NO_NORMAL) < 0.1, "nearly all points lie on the surface"
    floor = (np.abs(points[:, 2]) < 0.02) & (normals[:, 0] != NO_NORMAL)
    assert np.abs(normals[floor].astype(int)).sum(axis=1).mean() < 10, "it looks up"


def test_a_changed_map_is_drawn_anew(
    stages: Callable[[str], Stages], small_world: SmallWorld, tmp_path: Path
):
    before = points_on(small_world, 30_000) + [400.0, -250.0, 12.0]  # far from the frame's zero
    box = np.random.default_rng(5).uniform([402, -251, 12], [403, -250, 13], (3000, 3))
    np.save(tmp_path / "before.npy", before)
    np.save(tmp_path / "after.npy", np.concatenate([before, box]))
    at = stages("work")
    _, first = at.draw(tmp_path / "before.npy")
    _, second = at.draw(tmp_path / "after.npy")
    drawn, anew = (cloud_of(one.directory)[1] for one in (first, second))
    assert far_apart(drawn, before) < THINNED_M
    assert far_apart(anew, np.concatenate([before, box])) < THINNED_M
    assert far_apart(box, anew) < 0.1 < 0.5 < far_apart(box, drawn)
    assert first.digest != second.digest
    _, back = at.draw(tmp_path / "before.npy")
    assert (back.key, back.digest) == (first.key, first.digest)


def test_intensity_is_for_the_page_alone(small_world: SmallWorld, tmp_path: Path):
    """Two builds of the same points, one of a file with an intensity: queries get the same files."""
    points = points_on(small_world, 40_000)
    np.savetxt(tmp_path / "bare.xyz", points, fmt="%.3f")
    np.savetxt(tmp_path / "bright.xyz", np.c_[points, 100 + 9 * points[:, 0]], fmt="%.3f")
    built = {
        name: build_version(tmp_path / f"{name}.xyz", BuildConfig.parse(COARSE_CONFIG), tmp_path / name)
        for name in ("bare", "bright")
    }
    bare, bright = (one.manifest for one in built.values())
    assert dict(bare.query_files) == dict(bright.query_files)
    assert CLOUD_INTENSITY not in bare.files
    index, drawn, _ = cloud_of(built["bright"].directory)
    low, high = index["intensity"]
    told = low + np.fromfile(built["bright"].directory / CLOUD_INTENSITY, np.uint8) * (high - low) / 255
    assert len(told) == index["points"]
    assert np.median(np.abs(told - (100 + 9 * drawn[:, 0]))) < 0.5


def test_a_map_is_drawn_in_its_own_frame(
    stages: Callable[[str], Stages], small_world: SmallWorld, tmp_path: Path
):
    """The builder levels a tilted map; poses and clouds are in the frame of the file nevertheless."""
    c, s = np.cos(np.radians(6)), np.sin(np.radians(6))
    tilt = make_transform([[1, 0, 0], [0, c, -s], [0, s, c]], [5.0, 6.0, 7.0])
    tilted = transform_points(tilt, points_on(small_world, 30_000))
    np.save(tmp_path / "tilted.npy", tilted)
    read, drawn = stages("work").draw(tmp_path / "tilted.npy")
    turned_deg = rotation_angle_deg(read.T_map_level[:3, :3])
    assert turned_deg == pytest.approx(6, abs=1.5)
    _, points, _ = cloud_of(drawn.directory)
    assert far_apart(points, tilted) < THINNED_M
    np.testing.assert_allclose(points.mean(axis=0), tilted.mean(axis=0), atol=0.15)


def test_points_far_from_the_surface_have_no_normals(stages: Callable[[str], Stages], tmp_path: Path):
    rng = np.random.default_rng(1)
    np.save(tmp_path / "elsewhere.npy", rng.uniform([0, 0, 0], [20, 15, 1.0], (30_000, 3)) + [0, 0, 90])
    read, drawn = stages("work").draw(tmp_path / "elsewhere.npy", BuildConfig.parse({"level": False}))
    _, points, normals = cloud_of(drawn.directory)
    local = points - read.T_map_level[:3, 3]
    assert len(points) > 20_000
    assert local[:, 2].min() > 20, "far above the index's surface"
    assert (normals == NO_NORMAL).all()

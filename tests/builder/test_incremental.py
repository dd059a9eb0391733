"""A map of which a part has changed: that part is made again, with the version of a build from nothing."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from firstfix.builds.config import BuildConfig
from firstfix_builder.execution.build_trace import BuildTrace
from firstfix_builder.index.key_scans import TILE_M
from firstfix_builder.index.views import FAR, NEAR
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.pipeline import build_version
from firstfix_builder.simulation import local_simulator
from tests.small_world import COARSE_CONFIG

pytestmark = pytest.mark.slow

RANGE_M = BuildConfig.parse(COARSE_CONFIG).sensor_model.max_range_m


def corridor(path: Path, *, changed: bool = False) -> Path:
    """A corridor of 200 x 10 m with a box every five metres; one at its end may be moved."""
    rng = np.random.default_rng(3)
    parts = []

    def add(centre: tuple[float, ...], size: tuple[float, ...]) -> None:
        box = trimesh.creation.box(size, trimesh.transformations.translation_matrix(centre))
        vertices, faces = trimesh.remesh.subdivide_to_size(box.vertices, box.faces, 3.0)
        parts.append(trimesh.Trimesh(vertices, faces, process=False))

    add((100, 5, -0.1), (200.2, 10.2, 0.2))
    for y in (-0.1, 10.1):
        add((100, y, 1.5), (200.2, 0.2, 3))
    for x in (-0.1, 200.1):
        add((x, 5, 1.5), (0.2, 10, 3))
    for number, x in enumerate(np.arange(3.0, 200.0, 5.0)):
        size = rng.uniform(0.5, 1.6, 3)
        y = rng.uniform(1.5, 8.5)
        add((x, 11 - y if changed and number == 38 else y, size[2] / 2), tuple(size))
    path.parent.mkdir(exist_ok=True)
    trimesh.util.concatenate(parts).export(path)
    return path


CONFIG = {**COARSE_CONFIG, "viewpoints": {"spacing_m": 1.5, "tile_m": 48.0}}


def build(source: Path, work: Path) -> tuple[BuildResult, dict[str, tuple[int, int]]]:
    """Returns the version, and the chunks of each stage with the number of those reused."""
    with BuildTrace("b", "m", None) as trace:
        built = build_version(source, BuildConfig.parse(CONFIG), work, progress=lambda s, f: trace.tick(s))
        trace.end("succeeded")
    return built, {s.stage: (s.chunks, s.chunks_reused) for s in trace.stages if s.chunks}


def test_only_what_the_change_can_reach_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    before = corridor(tmp_path / "before.ply")
    after = corridor(tmp_path / "after.ply", changed=True)
    first, made = build(before, tmp_path / "work")
    count = made["make_templates"][0]
    assert count >= 8
    assert made["make_templates"][1] == 0
    second, reused = build(after, tmp_path / "work")
    with monkeypatch.context() as patched:  # as if the mesh were too large for one simulator
        patched.setattr(local_simulator, "WHOLE_TRIANGLES", 0)
        fresh, anew = build(after, tmp_path / "fresh")
    assert second.manifest.digest == fresh.manifest.digest != first.manifest.digest
    assert anew["make_templates"] == (count, 0)
    tile_m, reach_m = 24.0, _descriptor_range_m(second)
    near = _tiles_near_the_change(tile_m, reach_m)
    assert reused["make_templates"] == (count, count - near), "those whose cells can hold the change"
    views = sum(-(-200 // int(reach.tile_m)) for reach in (NEAR, FAR))
    changed = sum(_tiles_near_the_change(reach.tile_m, min(reach.within_m, RANGE_M)) for reach in (NEAR, FAR))
    assert reused["build_index"] == (views, views - changed), "those that can see the change"
    scans = -(-200 // int(TILE_M))
    assert anew["learn_keys"] == (scans, 0)
    assert 0 < reused["learn_keys"][1] < scans
    chunks, kept = reused["sample_viewpoints"]
    assert anew["sample_viewpoints"][1] == 0
    # of 7 tiles of 33 m, the change is in one, near another, and seen from those within the sensor's range
    assert kept >= 5
    assert chunks - kept < chunks / 2
    back, again = build(before, tmp_path / "work")
    assert back.manifest.digest == first.manifest.digest
    assert again == {}, "the whole stages are there"


def _tiles_near_the_change(tile_m: float, reach_m: float) -> int:
    """Number of tiles from which the moved box is within reach."""
    return sum((tile + 1) * tile_m + reach_m >= 192.2 for tile in range(-(-200 // int(tile_m))))


def _descriptor_range_m(built: BuildResult) -> float:
    engine: dict[str, Any] = json.loads((built.directory / "engine.json").read_text())
    return float(engine["descriptor"]["max_range_m"])

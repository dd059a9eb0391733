"""The change of a surface: a scan whose rays do not meet it is the same to the last bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.sensor import preset
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.tiled_mesh import TiledMesh
from firstfix_builder.simulation import changed_surface
from firstfix_builder.simulation.changed_surface import ChangedSurface
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator, upright
from tests.builder.box_scenes import box, floor

SENSOR = replace(preset("vlp-16"), azimuth_step_deg=2.0, max_range_m=60.0)
RAYS = Rays.at_any_heading(SENSOR)
SIDE_M = 60.0


def world(boxes: list[tuple[NDArray[np.float64], NDArray[np.float64]]]) -> Mesh:
    """Floor in squares of 4 m, so that a change does not concern all of it, and boxes on it."""
    squares = [
        floor(x, y, x + 4, y + 4) for x in np.arange(0.0, SIDE_M, 4.0) for y in np.arange(0.0, SIDE_M, 4.0)
    ]
    return Mesh.joined([*squares, *(box(tuple(low), tuple(high)) for low, high in boxes)])


def random_box(rng: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    low = np.append(rng.uniform(2, SIDE_M - 8, 2), 0.0)
    return low, low + rng.uniform((0.3, 0.3, 0.5), (6, 6, 5))


def saved(mesh: Mesh, folder: Path) -> Path:
    folder.mkdir()
    TiledMesh.of(mesh).save(folder)
    return folder


def changed(before: Mesh, after: Mesh, folder: Path) -> ChangedSurface:
    found = ChangedSurface.of(
        saved(before, folder / "before"), saved(after, folder / "after"), SENSOR.max_range_m
    )
    assert found is not None
    return found


def ranges(mesh: Mesh, origin: NDArray[np.float64]) -> NDArray[np.float32]:
    return next(Simulator(mesh.vertices, mesh.triangles).ranges(upright(origin[None]), SENSOR, RAYS))[0]


def is_met(change: ChangedSurface, origin: NDArray[np.float64], reach_m: float = SENSOR.max_range_m) -> bool:
    return change.is_met(origin[None], RAYS, reach_m, SENSOR.max_range_m)


@pytest.mark.parametrize("seed", range(6))
def test_a_scan_that_does_not_meet_the_change_is_the_same_to_the_last_bit(tmp_path: Path, seed: int):
    rng = np.random.default_rng(seed)
    boxes = [random_box(rng) for _ in range(60)]
    kind = ("gone", "come", "moved")[seed % 3]
    some, others = boxes[:2], boxes[2:]
    instead = {
        "gone": [],
        "come": [*some, random_box(rng), random_box(rng)],
        "moved": [(low + (0.4, 0.2, 0), high + (0.4, 0.2, 0)) for low, high in some],
    }
    other = [*instead[kind], *others]
    before, after = world(boxes), world(other)
    change = changed(before, after, tmp_path)
    origins = np.column_stack([rng.uniform(1, SIDE_M - 1, (120, 2)), rng.uniform(0.3, 2.5, 120)])
    met = np.array([is_met(change, one) for one in origins])
    same = np.array([np.array_equal(ranges(before, one), ranges(after, one)) for one in origins])
    assert same[~met].all()
    assert (~met).sum() >= 5, "what is hidden from the change is kept"
    assert (~same).any(), "some scans do differ"


@pytest.mark.parametrize("how", ["come in front", "gone"])
def test_a_thing_in_front_of_what_was_seen_is_met_whether_it_comes_or_goes(tmp_path: Path, how: str):
    wall, thing = (
        (np.array([40.0, 0, 0]), np.array([41.0, 60, 3])),
        (np.array([24, 20.0, 0]), np.array([25, 21.0, 2])),
    )
    pair = world([wall]), world([wall, thing])
    before, after = pair if how == "come in front" else pair[::-1]
    change = changed(before, after, tmp_path)
    assert is_met(change, np.array([18.0, 20.5, 1.0]))
    assert not is_met(change, np.array([50.0, 20.5, 1.0])), "behind the wall"
    assert not is_met(change, np.array([8.0, 20.5, 1.0]), reach_m=10.0), "further away than what counts"


def test_within_a_changed_box_a_scan_is_met(tmp_path: Path):
    change = changed(world([]), world([(np.array([20.0, 20, 0]), np.array([30.0, 30, 3]))]), tmp_path)
    assert is_met(change, np.array([25.0, 25, 1]))


def test_equal_surfaces_concern_no_ray(tmp_path: Path):
    change = changed(world([]), world([]), tmp_path)
    assert not is_met(change, np.array([25.0, 25, 1]))


def test_of_a_large_change_no_ray_is_followed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(changed_surface, "MOST_CELLS", 0)
    one = world([(np.array([20.0, 20, 0]), np.array([30.0, 30, 3]))])
    before, after = saved(world([]), tmp_path / "before"), saved(one, tmp_path / "after")
    assert ChangedSurface.of(before, after, SENSOR.max_range_m) is None


@pytest.mark.parametrize("seed", range(3))
def test_every_ray_that_ends_elsewhere_may_meet_the_change(tmp_path: Path, seed: int):
    rng = np.random.default_rng(seed)
    boxes = [random_box(rng) for _ in range(40)]
    before, after = world(boxes), world([*boxes[3:], random_box(rng)])
    change = changed(before, after, tmp_path)
    at = np.column_stack([rng.uniform(0, SIDE_M, (30, 2)), np.full(30, 1.2)])
    met = change.met_by(at, RAYS, SENSOR.max_range_m)
    then, now = (np.array([ranges(mesh, origin) for origin in at]) for mesh in (before, after))
    assert not ((then != now) & ~met).any()
    assert met.mean() < 0.3
    within = np.array([origin for origin in at if change.is_within(origin[None], 10.0)])
    gap_m = [
        np.linalg.norm(np.clip(origin[:2], change.low[:, :2], change.high[:, :2]) - origin[:2], axis=1)
        for origin in at
    ]
    assert len(within) == sum(gap.min() <= 10.0 for gap in gap_m)


def test_points_in_a_changed_box_are_told(tmp_path: Path):
    rng = np.random.default_rng(4)
    boxes = [random_box(rng) for _ in range(20)]
    change = changed(world(boxes), world(boxes[4:]), tmp_path)
    points = rng.uniform(0, SIDE_M, (5000, 3)).astype(np.float32) * np.float32([1, 1, 0.1])
    inside = (points[:, None] >= change.low) & (points[:, None] <= change.high)
    held = change.holds(points)
    assert held.any()
    np.testing.assert_array_equal(held, inside.all(axis=2).any(axis=1))

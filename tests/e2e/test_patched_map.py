"""The closed loop: a world changes, robots are localized in it, and the map is patched by what they saw."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from changed_hall import free_poses, surface_points
from firstfix.answer.options import LocalizeOptions
from firstfix.builds.options import BuildOptions
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.query_samples import QuerySample, QuerySamples, new_sample_id, robot_of
from firstfix.catalog.sources import put_source
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.store.store import Store
from firstfix_builder.job.run_build import run_build
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.worker import build_here
from small_world import SENSOR, SmallWorld

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]
CONFIG = {
    "sensor": SENSOR,
    "provisional": False,
    "viewpoints": {"spacing_m": 1.4},
    "learn_keys": {"scans": 0},
    "self_test": {
        "queries": 32,
        "outside": 8,
        "mirrored": 8,
        "perturb": {"occluders": 1, "strangers": 0, "unmapped": 0, "vanished": 0},
    },
}
GONE = np.array([[-2.42, -2.95, 0.0], [-0.52, -0.9, 1.66]])  # corners of a box that leaves,
NEW = np.array([[2.4, -5.0, 0.0], [3.8, -3.8, 1.5]])  # and of one that comes
MONDAY = datetime(2026, 3, 2, 9, tzinfo=timezone.utc)


class Place:
    """A store with the map of the yard, and the yard as it is now."""

    def __init__(self, world: SmallWorld, folder: Path) -> None:
        self.url = f"file://{folder}/store"
        self.folder = folder
        self.catalog = Catalog(Store.open(self.url))
        self.samples = QuerySamples(self.catalog.store)
        self.simulator = Simulator(world.vertices, world.triangles)
        self._rng = np.random.default_rng(5)
        points, _ = surface_points(world.vertices[world.triangles], 0.1)
        seen = (np.abs(points) < [8.05, 6.05, 4.0]).all(axis=1) & (points[:, 2] > -0.05)  # as a mapping run does
        np.save(folder / "cloud.npy", points[seen])
        self._sha256 = put_source(self.catalog.store, "yard", folder / "cloud.npy")
        leaves = 8 * 15  # vertices of the box that leaves: it becomes the one that comes
        assert np.allclose(world.vertices[leaves : leaves + 8].min(axis=0)[2], 0.0)
        moved = world.vertices.copy()
        low, high = moved[leaves : leaves + 8].min(axis=0), moved[leaves : leaves + 8].max(axis=0)
        unit = (moved[leaves : leaves + 8] - low) / (high - low)
        moved[leaves : leaves + 8] = NEW[0] + unit * (NEW[1] - NEW[0])
        self.now = Simulator(moved, world.triangles)

    def build(self, build_id: str, **changes: Any) -> dict[str, Any]:
        """Runs a build of the yard as the service does. Returns its status."""
        request = {
            "map_id": "yard",
            "source": {"key": f"maps/yard/sources/{self._sha256}"},
            "file_name": "cloud.npy",
            "trajectory": None,
            "config": {**CONFIG, "patch": "activate"},
            **changes,
        }
        self.catalog.put_build(build_id, request)
        options = BuildOptions(
            store=self.url, build_id=build_id, work=self.folder / "work", sandbox="off", log_level="critical"
        )
        run_build(options, partial(build_here, options, None))
        return self.catalog.build_status(build_id)

    def localizer(self, version: str) -> Localizer:
        folder = self.catalog.fetch_version("yard", version, self.folder / "cache")
        return Localizer(MapIndex.load(folder), explains=False)

    def scan(self, simulator: Simulator, T: NDArray[np.float64]) -> NDArray[np.float32]:
        sensor = SensorModel.from_mapping(SENSOR)
        rays = Rays.of_sensor(sensor)
        ranges = next(simulator.ranges(T[None], sensor, rays))[0]
        ranges = ranges + self._rng.normal(0, 0.02, len(ranges)).astype(np.float32)
        seen = np.isfinite(ranges)
        return np.ascontiguousarray(rays.directions[seen] * ranges[seen, None], np.float32)

    def ask(
        self, localizer: Localizer, version: str, callers: Sequence[str], days: Sequence[int], count: int
    ) -> list[float]:
        """Queries in the yard as it is now, kept. Returns their errors in metres."""
        poses = free_poses(self.now, (7.0, 5.0), len(callers) * len(days) * count, self._rng)
        errors_m = []
        for caller in callers:
            for day in days:
                for minute in range(count):
                    T = poses.pop()
                    T[:2, 3] = T[:2, 3] * [2.0, 2.0] - [7.0, 5.0]
                    T[2, 3] = 0.8
                    if not self.now.is_free(T[None, :3, 3], 0.4)[0]:
                        continue
                    points = self.scan(self.now, T)
                    answer = localizer.localize(Scan.from_points(points), LocalizeOptions())
                    if answer.T_map_sensor is not None:
                        errors_m.append(float(np.linalg.norm((answer.T_map_sensor - T)[:3, 3])))
                    self.keep(caller, MONDAY + timedelta(days=day, minutes=10 * minute), answer, points, version)
        return errors_m

    def keep(self, caller: str, time: datetime, answer: Any, points: NDArray[np.float32], version: str) -> None:
        body = points.tobytes()
        told = {**answer.to_mapping(), "map_id": "yard", "map_version": version}
        sample_id = new_sample_id(f"{self._rng.integers(2**32):08x}", time)
        sample = QuerySample(
            sample_id, time.isoformat(), "http", "r", "", "yard", "application/vnd.firstfix.xyz", "", {}, told,
            len(body), robot=robot_of(caller),
        )  # fmt: skip
        self.samples.put(sample, body)


@pytest.fixture(scope="module")
def place(small_world: SmallWorld, tmp_path_factory: pytest.TempPathFactory) -> Place:
    return Place(small_world, tmp_path_factory.mktemp("patched"))


def points_in(index: MapIndex, box: NDArray[np.float64]) -> int:
    """Number of the map's fine surface cells in a box, above the floor."""
    low, high = box[0] + [-0.05, -0.05, 0.25], box[1] + 0.05
    grid = index.surface.fine
    step = np.arange(0.05, 1.0, 0.1)
    at = low + (high - low) * np.stack(np.meshgrid(step, step, step, indexing="ij"), axis=-1).reshape(-1, 3)
    row = grid.nearest(np.ascontiguousarray(at - grid.corner, np.float32))
    return len(np.unique(row[row >= 0]))


def test_a_changed_world_becomes_a_patched_map(place: Place) -> None:
    base = str(place.build("b1")["version"])
    before = place.localizer(base)
    alone = place.build("b2", patch={"base": base})
    assert alone["state"] == "failed"
    assert "nothing to patch" in alone["error"]["detail"]

    place.ask(before, base, ["key:ann"], range(4), 6)
    lonely = place.build("b3", patch={"base": base})
    assert lonely["state"] == "failed"
    assert "of 1 robots" in lonely["error"]["detail"]

    place.ask(before, base, ["address:10.0.0.7"], range(4), 2)  # anybody: it counts for nothing
    place.ask(before, base, ["key:bob"], range(4), 6)
    status = place.build("b4", patch={"base": base})
    print(status)
    assert status["state"] == "succeeded", status
    print(place.catalog.manifest("yard", status["version"]).source["patch"])
    assert status["activated"]
    patched = str(status["version"])
    assert place.catalog.active_version("yard") == patched != base
    assert [one["code"] for one in status["findings"]] == ["map_patched"]
    record = place.catalog.manifest("yard", patched).source["patch"]
    print(record)
    after = place.localizer(patched)
    print(points_in(before.index, GONE), points_in(after.index, GONE), points_in(before.index, NEW), points_in(after.index, NEW))
    assert place.catalog.roll_back("yard") == base
    print(place.catalog.log("yard"))

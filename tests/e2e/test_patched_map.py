"""The closed loop: a world changes, robots are localized in it, and the map is patched by what they saw."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from changed_hall import surface_points
from firstfix.answer.localization import Localization
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
        seen = (np.abs(points) < [8.05, 6.05, 4.0]).all(axis=1) & (
            points[:, 2] > -0.05
        )  # as a mapping run does
        np.save(folder / "cloud.npy", points[seen])
        self._sha256 = put_source(self.catalog.store, "yard", folder / "cloud.npy")
        moved = world.vertices.copy()
        leaves = slice(8 * 15, 8 * 16)  # vertices of the box that leaves: it becomes the one that comes
        low, high = moved[leaves].min(axis=0), moved[leaves].max(axis=0)
        assert np.allclose([low, high], GONE, atol=0.01)
        moved[leaves] = NEW[0] + (moved[leaves] - low) / (high - low) * (NEW[1] - NEW[0])
        self.now = Simulator(moved, world.triangles)

    def build(self, build_id: str, **changes: Any) -> dict[str, Any]:
        """Runs a build of the yard as the service does. Returns its status."""
        request = {
            "map_id": "yard",
            "source": {"key": f"maps/yard/sources/{self._sha256}"},
            "file_name": "cloud.npy",
            "trajectory": None,
            "config": CONFIG,
            **changes,
        }
        self.catalog.put_build(build_id, request)
        options = BuildOptions(
            store=self.url, build_id=build_id, work=self.folder / "work", sandbox="off", log_level="critical"
        )
        run_build(options, partial(build_here, options, None))
        return self.catalog.build_status(build_id)

    def patch(self, build_id: str, base: str, mode: str = "activate") -> dict[str, Any]:
        """Runs the build of a patch. Returns its status."""
        return self.build(build_id, patch={"base": base, "mode": mode})

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
        errors_m = []
        for caller, day, minute in product(callers, days, range(count)):
            T = np.eye(4)
            while True:
                T[:3, 3] = [*self._rng.uniform([-7.0, -5.0], [7.0, 5.0]), 0.8]
                if self.now.is_free(T[None, :3, 3], 0.4)[0]:
                    break
            points = self.scan(self.now, T)
            answer = localizer.localize(Scan.from_points(points), LocalizeOptions())
            if answer.T_map_sensor is not None:
                errors_m.append(float(np.linalg.norm((answer.T_map_sensor - T)[:3, 3])))
            time = MONDAY + timedelta(days=day, minutes=10 * minute)
            self.keep(caller, time, answer, points.tobytes(), version)
        return errors_m

    def keep(self, caller: str, time: datetime, answer: Localization, body: bytes, version: str) -> None:
        told = {**answer.to_mapping(), "map_id": "yard", "map_version": version}
        sample_id = new_sample_id(f"{self._rng.integers(2**32):08x}", time)
        media_type = "application/vnd.firstfix.xyz"
        sample = QuerySample(
            sample_id, time.isoformat(), "http", "r", "", "yard", media_type, "", {}, told, len(body),
            robot=robot_of(caller),
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
    assert place.catalog.active_version("yard") == base
    before = place.localizer(base)
    nothing = place.patch("b2", base)
    assert nothing["state"] == "failed"
    assert "nothing to patch" in nothing["error"]["detail"]

    place.ask(before, base, ["key:ann"], range(4), 6)
    lonely = place.patch("b3", base)
    assert lonely["state"] == "failed"
    assert "of 1 robots" in lonely["error"]["detail"]
    assert place.catalog.active_version("yard") == base

    place.ask(before, base, ["address:10.0.0.7"], range(4), 2)  # anybody: it counts for nothing
    errors_m = place.ask(before, base, ["key:bob"], range(4), 6)
    assert len(errors_m) >= 10
    assert max(errors_m) < 0.1
    status = place.patch("b4", base)
    assert status["state"] == "succeeded", status
    patched = str(status["version"])
    assert status["activated"], status["findings"]
    assert place.catalog.active_version("yard") == patched != base
    assert [one["code"] for one in status["findings"]] == ["map_patched"]
    record = place.catalog.manifest("yard", patched).source["patch"]
    assert (record["base"], record["robots"]) == (base, 2)
    assert record["compared"]["places"] >= 10
    areas = {one["kind"]: np.array([one["low_m"], one["high_m"]]) for one in record["areas"]}
    assert np.abs(areas["gone"] - GONE).max() < 0.6
    assert np.abs(areas["new"] - NEW).max() < 0.6

    after = place.localizer(patched)
    assert points_in(before.index, GONE) > 200
    assert points_in(after.index, GONE) < 0.1 * points_in(before.index, GONE)
    assert points_in(before.index, NEW) == 0
    assert points_in(after.index, NEW) > 100
    errors_m = place.ask(after, patched, ["key:cat"], [5], 6)
    assert max(errors_m) < 0.1

    assert place.catalog.roll_back("yard") == base
    assert place.localizer(base).index.surface.fine.planes.shape == before.index.surface.fine.planes.shape
    proposed = place.patch("b5", base, mode="propose")
    assert (proposed["version"], proposed["activated"]) == (patched, False)
    assert [one["code"] for one in proposed["findings"]] == ["map_patched", "patch_proposed"]
    assert place.catalog.active_version("yard") == base
    place.catalog.activate("yard", patched)  # a person clicks
    assert place.catalog.active_version("yard") == patched

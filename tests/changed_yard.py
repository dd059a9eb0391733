"""The yard after a box has left and another one has come, and the robots that are asked in it."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.small_world import SENSOR, SmallWorld

if TYPE_CHECKING:  # a plugin too, and open3d: both are imported when a test needs them
    from firstfix.answer.localization import Localization
    from firstfix.engine.localizer import Localizer
    from firstfix_builder.job.build_job import BuildResult
    from firstfix_builder.simulation.simulate import Simulator
    from tests.once_a_run import OnceARun

CONFIG = {
    "sensor": SENSOR,
    "provisional": False,
    "viewpoints": {"spacing_m": 1.4},
    "learn_keys": {"scans": 0},
    "self_test": {
        "queries": 32,
        "outside": 8,
        "perturb": {"occluders": 1, "strangers": 0, "unmapped": 0, "vanished": 0},
    },
}
GONE = np.array([[-2.42, -2.95, 0.0], [-0.52, -0.9, 1.66]])  # corners of a box that leaves,
NEW = np.array([[2.4, -5.0, 0.0], [3.8, -3.8, 1.5]])  # and of one that comes
MONDAY = datetime(2026, 3, 2, 9, tzinfo=timezone.utc)


def write_cloud(world: SmallWorld, path: Path) -> Path:
    """Writes the yard as a mapping run sees it before anything has changed."""
    from tests.changed_hall import surface_points

    points, _ = surface_points(world.vertices[world.triangles], 0.1)
    seen = (np.abs(points) < [8.05, 6.05, 4.0]).all(axis=1) & (points[:, 2] > -0.05)
    np.save(path, points[seen])
    return path


@pytest.fixture(scope="session")
def cloud_version(small_world: SmallWorld, once_a_run: OnceARun) -> BuildResult:
    """The version of the yard's cloud, to be read only: the builds of a ``ChangedYard`` begin as this one."""
    return once_a_run.version(
        "yard-cloud", lambda folder: write_cloud(small_world, folder / "cloud.npy"), CONFIG
    )


class ChangedYard:
    """A map of the yard's cloud in a store, and the yard as it is now.

    Attributes:
        request: of a build of the map.
        now: the yard as it is now.
    """

    def __init__(
        self, world: SmallWorld, folder: Path, url: str, map_id: str, start: datetime = MONDAY
    ) -> None:
        from firstfix.catalog.catalog import Catalog
        from firstfix.catalog.recorded_queries import RecordedQueries
        from firstfix.catalog.sources import put_source
        from firstfix.store.store import Store
        from firstfix_builder.simulation.simulate import Simulator

        self.url = url
        self.folder = folder
        self.map_id = map_id
        self.catalog = Catalog(Store.open(url))
        self.recorded_queries = RecordedQueries(self.catalog.store)
        self._start = start
        self._rng = np.random.default_rng(5)
        sha256 = put_source(self.catalog.store, map_id, write_cloud(world, folder / "cloud.npy"))
        self.request: dict[str, Any] = {
            "map_id": map_id,
            "source": {"key": f"maps/{map_id}/sources/{sha256}"},
            "file_name": "cloud.npy",
            "trajectory": None,
            "config": CONFIG,
        }
        moved = world.vertices.copy()
        leaves = slice(8 * 15, 8 * 16)  # vertices of the box that leaves: it becomes the one that comes
        low, high = moved[leaves].min(axis=0), moved[leaves].max(axis=0)
        assert np.allclose([low, high], GONE, atol=0.01)
        moved[leaves] = NEW[0] + (moved[leaves] - low) / (high - low) * (NEW[1] - NEW[0])
        self.now = Simulator(moved, world.triangles)

    def localizer(self, version: str) -> Localizer:
        from firstfix.engine.index import MapIndex
        from firstfix.engine.localizer import Localizer

        folder = self.catalog.fetch_version(self.map_id, version, self.folder / "cache")
        return Localizer(MapIndex.load(folder), explains=False)

    def scan(self, simulator: Simulator, T: NDArray[np.float64]) -> NDArray[np.float32]:
        from firstfix.sensor import SensorModel
        from firstfix_builder.simulation.rays import Rays

        sensor = SensorModel.from_mapping(SENSOR)
        rays = Rays.of_sensor(sensor)
        ranges = next(simulator.ranges(T[None], sensor, rays))[0]
        ranges = ranges + self._rng.normal(0, 0.02, len(ranges)).astype(np.float32)
        seen = np.isfinite(ranges)
        return np.ascontiguousarray(rays.directions[seen] * ranges[seen, None], np.float32)

    def ask(
        self, localizer: Localizer, version: str, callers: Sequence[str], days: Sequence[int], count: int
    ) -> list[float]:
        """Queries in the yard as it is now, recorded. Returns their errors in metres."""
        from firstfix.answer.options import LocalizeOptions
        from firstfix.scan.scan import Scan

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
            time = self._start + timedelta(days=day, minutes=10 * minute)
            self.record(caller, time, answer, points.tobytes(), version)
        return errors_m

    def record(self, caller: str, time: datetime, answer: Localization, body: bytes, version: str) -> None:
        from firstfix.catalog.recorded_queries import RecordedQuery, new_query_id, robot_of

        told = {**answer.to_mapping(), "map_id": self.map_id, "map_version": version}
        query_id = new_query_id(f"{self._rng.integers(2**32):08x}", time)
        media_type = "application/vnd.firstfix.xyz"
        recorded = RecordedQuery(
            query_id, time.isoformat(), "http", "r", "", self.map_id, media_type, "", {}, told, len(body),
            robot=robot_of(caller),
        )  # fmt: skip
        self.recorded_queries.put(recorded, body)

"""The folder of a patch: which recorded queries are collected."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.engine.changes.areas import Area
from firstfix.errors import BuildFailed
from firstfix.store.store import Store
from firstfix_builder.job import recorded_queries
from firstfix_builder.job.patch_source import PatchSource, collect_patch_source, is_patch_source
from firstfix_builder.job.recorded_queries import chosen_queries
from firstfix_builder.sources.patch.recorded_scans import read_observations
from tests.builder.fixtures import record_query

DAY_S = 86400.0
NOON = datetime(2026, 3, 2, 12, tzinfo=timezone.utc)


class Recorded:
    """A store with a version of one map, and recorded queries."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.catalog = Catalog(Store.open("memory://"))
        self.recorded_queries = RecordedQueries(self.catalog.store)
        (folder / "version").mkdir()
        (folder / "version" / "index.bin").write_bytes(b"i")
        manifest = Manifest.for_directory(folder / "version")
        self.version = self.catalog.publish("hall", folder / "version", manifest)
        (folder / "hall.ply").write_bytes(b"cloud")

    def record(self, robot: str, after_s: float, x: float = 0.0, body: bytes = b"", **answer: Any) -> None:
        at = {"position": [x, 0.0, 1.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
        said = {"verdict": "localized", "reasons": [], "probability": 0.999, "T_map_sensor": at}
        said |= {"map_id": "hall", "map_version": self.version} | answer
        body = body or np.ones((60, 3), "<f4").tobytes()
        record_query(self.recorded_queries, NOON + timedelta(seconds=after_s), said, body, robot=robot)

    def collect(self) -> PatchSource:
        files = {"source": self.folder / "hall.ply"}
        folder = self.folder / "patch"
        collect_patch_source(self.catalog, self.recorded_queries, "hall", self.version, files, folder)
        return PatchSource.load(folder)


@pytest.fixture
def recorded(tmp_path: Path) -> Recorded:
    return Recorded(tmp_path)


def test_localized_queries_of_robots_are_collected_oldest_first(recorded: Recorded):
    recorded.record("bob", 10.0)
    recorded.record("ann", 0.0)
    found = recorded.collect()
    assert [one.robot for one in found.queries] == ["ann", "bob"]
    assert (found.source, found.trajectory, found.base) == ("source/hall.ply", None, recorded.version)
    folder = recorded.folder / "patch"
    assert is_patch_source(folder)
    assert (folder / found.source).read_bytes() == b"cloud"
    assert (folder / "base" / "index.bin").read_bytes() == b"i"
    observations = read_observations(folder, found)
    assert [one.time_s - NOON.timestamp() for one in observations] == [0.0, 10.0]
    assert len(observations[0].scan.points) == 60


@pytest.mark.parametrize(
    ("robot", "answer"),
    [
        ("", {}),
        ("ann", {"verdict": "ambiguous", "T_map_sensor": None}),
        ("ann", {"probability": 0.98}),
        ("ann", {"map_version": "0" * 64}),
        ("ann", {"map_id": "yard"}),
        ("ann", {"T_map_sensor": {"position": [1.0]}}),
    ],
)
def test_other_queries_are_not_collected(recorded: Recorded, robot: str, answer: dict[str, Any]):
    recorded.record(robot, 0.0, **answer)
    with pytest.raises(BuildFailed, match="nothing to patch"):
        recorded.collect()


def test_a_robot_cannot_crowd_out_the_others(recorded: Recorded, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(recorded_queries, "MAX_QUERIES", 6)
    recorded.record("bob", 0.0)
    for number in range(8):
        recorded.record("ann", 100.0 + number, x=0.1 * number)  # in one place of 1 m, and in one hour
        recorded.record("ann", 200.0 + number, x=10.0 * number)
    robots = [one.robot for one in recorded.collect().queries]
    assert robots == ["bob", "ann", "ann", "ann"]


def test_all_days_have_equal_parts(recorded: Recorded, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(recorded_queries, "MAX_QUERIES", 12)
    for number in range(40):
        recorded.record("ann", 5 * DAY_S + number, x=10.0 * number)
    for day in range(5):
        recorded.record("ann", day * DAY_S)
    days = [int((one.time_s - NOON.timestamp()) // DAY_S) for one in recorded.collect().queries]
    assert days == [0, 1, 2, 3, 4, 5]


def test_queries_near_what_seems_changed_come_first(recorded: Recorded, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(recorded_queries, "MAX_QUERIES", 6)
    for number in range(20):
        recorded.record("ann", 60.0 * number, x=10.0 * number)
    cells = np.array([[200, 0, 2], [201, 0, 2], [202, 0, 2]])  # at x = 100 to 101.5 m
    area = Area("gone", cells, np.ones(3), np.full(3, 9), np.ones((3, 2), np.int64))
    near, any_place = (
        chosen_queries(recorded.recorded_queries, "hall", recorded.version, areas) for areas in ([area], [])
    )
    assert [one.position_m[0] for one in near] == pytest.approx([90, 100, 110])
    assert len(any_place) == 3
    assert {one.position_m[0] for one in any_place} != {90, 100, 110}


def test_a_body_that_is_no_scan_is_left_out(recorded: Recorded):
    recorded.record("ann", 0.0, body=b"12345")
    recorded.record("bob", 1.0)
    found = recorded.collect()
    assert [one.robot for one in read_observations(recorded.folder / "patch", found)] == ["bob"]

"""Recorded queries as viewers show them: which points, at which time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.catalog.recorded_queries import RecordedQuery
from firstfix.errors import CorruptVersion, InputError
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import make_transform, rotation_z
from firstfix.wire.scan import encode_scan
from firstfix.wire.sequence import encode_scans
from firstfix_builder.index.cloud_octree import CloudOctree
from firstfix_console.export.exported_query import UNPLACED_FRAME, exported_queries, read_scan
from firstfix_console.export.map_cloud import read_map_cloud
from firstfix_console.export.shown_scan import ShownScan, points_of

ANSWERED_S = 1_767_225_600.0  # 2026-01-01
REJECTED = Localization(Verdict.REJECTED).to_mapping()


@dataclass
class OneQuery:
    """A source with one recorded query."""

    content: bytes
    media_type: str
    answer: dict[str, Any]

    def recorded_queries(self) -> Iterator[RecordedQuery]:
        yield RecordedQuery(
            "s",
            "2026-01-01T00:00:00+00:00",
            "http",
            "r",
            "",
            "hall",
            self.media_type,
            "",
            {},
            self.answer,
            len(self.content),
        )

    def body(self, query_id: str) -> bytes:
        return self.content


def scan(stamp_s: float | None, seed: int = 1) -> Scan:
    return Scan.from_points(np.random.default_rng(seed).uniform(-9, 9, (200, 3)), stamp_s=stamp_s)


def exported(content: bytes, media_type: str, answer: dict[str, Any] = REJECTED) -> Any:
    source = OneQuery(content, media_type, answer)
    scan_of = partial(read_scan, source)  # type: ignore[arg-type]
    (query,) = exported_queries(source.recorded_queries(), "hall", scan_of)
    return query


@pytest.mark.parametrize(
    ("stamp_s", "shown_s"),
    [
        (ANSWERED_S - 0.25, ANSWERED_S - 0.25),
        (ANSWERED_S - 40_000.5, ANSWERED_S - 40_000.5),
        (1_600_000_000.0, ANSWERED_S),  # a recording that was played later
        (12.5, ANSWERED_S),  # a clock that begins when the robot starts
        (None, ANSWERED_S),
    ],
)
def test_the_time_is_the_scans_unless_its_clock_is_another(stamp_s: float | None, shown_s: float):
    query = exported(encode_scan(scan(stamp_s)), "application/vnd.firstfix.scan")
    assert query.time_ns == pytest.approx(shown_s * 1e9, abs=1000)
    assert query.frame == UNPLACED_FRAME


def test_scans_of_a_sequence_are_shown_in_the_frame_of_the_last():
    T_odom_sensor = [make_transform(rotation_z(0.5), [3.0, 1.0, 0.0]), np.eye(4)]
    sequence = ScanSequence.along([scan(None, 1), scan(None, 2)], T_odom_sensor)
    points = points_of(sequence)
    first, last = sequence.scans
    T = T_odom_sensor[0]
    np.testing.assert_allclose(points[:200], first.points @ T[:3, :3].T + T[:3, 3], atol=1e-5)
    np.testing.assert_array_equal(points[200:], last.points)
    assert (
        len(exported(encode_scans(sequence.scans, T_odom_sensor), "application/vnd.firstfix.scans").points)
        == 400
    )


@pytest.mark.parametrize("stamp_s", [ANSWERED_S, 0.0, None])
def test_a_scan_comes_from_a_worker_as_it_was(stamp_s: float | None):
    sent = ShownScan.of(scan(stamp_s))
    came = ShownScan.unpacked(sent.packed())
    np.testing.assert_array_equal(came.points, sent.points)
    assert (came.stamp_s, came.unreadable) == (stamp_s, "")


def test_a_record_of_an_unknown_kind_is_an_error():
    body = encode_scan(scan(None))
    with pytest.raises(InputError, match="recorded query s: its record cannot be read"):
        exported(body, "application/vnd.firstfix.scan", {**REJECTED, "verdict": "so-so"})


def test_a_body_of_an_unknown_kind_is_told():
    query = exported(b"x", "text/html")
    assert "unknown media type" in query.unreadable
    assert "its points cannot be shown" in query.words
    assert len(query.points) == 0


@pytest.mark.parametrize(
    "changed",
    [
        {"nodes": [[1, 0, 0, 0, 0, 5], [0, 0, 0, 0, 0, 5]]},
        {"nodes": [[0, 0, 0]]},
        {"nodes": None},
        {"low_m": [0, 0]},
        {"edge_m": float("nan")},
        {"marks": 7},
        {"intensity": [0]},
        {"intensity": [0, float("inf")]},
        {"intensity": [0, 1]},  # and eight bytes a point come
    ],
)
def test_an_index_that_is_none_is_refused(tmp_path, changed: dict[str, Any]):
    import json

    CloudOctree.of(np.random.default_rng(1).uniform(0, 9, (100, 3))).save(tmp_path)
    index = json.loads((tmp_path / "cloud.json").read_text())
    data = (tmp_path / "cloud.bin").read_bytes()

    def read(first: int, count: int) -> bytes:
        return data[8 * first : 8 * (first + count)]

    assert len(read_map_cloud(index, read, read, 1000).points) == 100
    with pytest.raises(CorruptVersion):
        read_map_cloud({**index, **changed}, read, read, 1000)

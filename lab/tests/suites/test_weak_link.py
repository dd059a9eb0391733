"""The weak link, and a few queries of every client over it (``firstfix-lab weak_link``: 100)."""

from __future__ import annotations

import random
import socket
from pathlib import Path

import numpy as np
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_lab.drills.weak_link.link import Conditions, Way, missing
from firstfix_lab.drills.weak_link.measure import measure
from firstfix_lab.drills.weak_link.robot import CLIENTS

pytestmark = pytest.mark.slow

PACKET = bytes([0x45]) + bytes(99)  # IPv4, as far as a link looks


@pytest.fixture
def pipes():
    """A pair that stands for the device at each end: what is sent into one is read at the other."""
    ends = [
        *socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM),
        *socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM),
    ]
    for end in ends:
        end.setblocking(False)
    yield ends
    for end in ends:
        end.close()


def test_packets_are_lost_at_the_rate_that_was_asked_for(pipes):
    robot, source, sink, service = pipes
    way = Way(source.fileno(), sink.fileno(), Conditions(1e12, 0.0, 0.1), random.Random(1))
    arrived = 0
    for _ in range(500):
        robot.send(PACKET)
        way.take()
        way.deliver()
        while True:
            try:
                assert service.recv(1000) == PACKET
            except BlockingIOError:
                break
            arrived += 1
    assert way.packets == 500
    assert arrived == 500 - way.lost
    assert 30 < way.lost < 70
    assert way.bytes == 100 * arrived


def test_packets_wait_for_those_before_them_and_for_the_way(pipes):
    robot, source, sink, service = pipes
    way = Way(source.fileno(), sink.fileno(), Conditions(800.0, 100.0, 0.0), random.Random(1))
    for _ in range(3):  # of a second each
        robot.send(PACKET)
    robot.send(bytes([0x60]) + bytes(39))  # IPv6: not for this link
    way.take()
    assert (way.packets, way.lost) == (3, 0)
    assert way.deliver() == 1.0
    assert [round(arrival_s - way._flying[0][0], 1) for arrival_s, _ in way._flying] == [0.0, 1.0, 2.0]
    with pytest.raises(BlockingIOError):
        service.recv(1000)


def test_no_query_is_lost_on_a_weak_link(small_version, small_scans, tmp_path: Path):
    if why := missing():
        pytest.skip(why)
    Catalog(Store.open(str(tmp_path / "store"))).publish(
        "yard", small_version.directory, small_version.manifest
    )
    scans = []
    for number, (scan, _) in enumerate(small_scans[:3]):
        scans.append(str(tmp_path / f"{number}.npy"))
        np.save(scans[-1], scan.points)
    conditions = Conditions(1e6, 0.1, 0.02)
    rows = dict(measure(conditions, tmp_path / "service", tmp_path / "store", "yard", tuple(scans), 3))
    beside = rows.pop("Client, compact, without the link")
    assert (beside["lost"], beside["queries"]) == ({}, 3)
    assert set(rows) == {*(f"{name}, compact" for name in CLIENTS), "Client, scan", "Client, raw"}
    for name, row in rows.items():
        assert row["lost"] == {}
        assert sum(row["verdicts"].values()) == row["queries"] == (3 if "compact" in name else 1)
        # a query's points are 2 KB at least: they came over the link and by no shorter way
        assert row["bytes_up"] > 2000
    assert (
        max(rows[f"{name}, compact"]["bytes_up"] for name in CLIENTS)
        < 10_000
        < rows["Client, raw"]["bytes_up"]
    )

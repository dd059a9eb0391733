"""On a network that drops 30 % of the datagrams, what a robot asks for is answered."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("cyclonedds", reason="the package cyclonedds is not here")

from benchmarks.common.datasets import HALL
from benchmarks.weak_link.link import missing
from tests.robots.dds_world import scenes
from tests.robots.lossy_network import POINTS, Told, ask, lossy_link, robot_over

pytestmark = pytest.mark.slow

LOSS, ASKS, WITHIN_M = 0.3, 3, 0.2


def test_what_is_asked_is_answered(program: Path, hall_store: Path, tmp_path: Path):
    reason = missing()
    if reason is not None:
        pytest.skip(reason)
    seen = scenes(HALL.write_queries(tmp_path / "poses.csv"), tmp_path, ASKS, points=POINTS)
    told = Told()
    with lossy_link(LOSS, 1, told) as link, robot_over(link, program, tmp_path, hall_store, "hall") as robot:
        ask(robot, seen, told)
    assert len(told.far_m) == ASKS
    assert max(told.far_m) < WITHIN_M
    assert 0.25 < told.lost < 0.35, "the link did not do what it is for"

"""A robot of another DDS on a network that drops datagrams: ``firstfix_lab.drills.lossy_dds`` in small."""

from __future__ import annotations

from pathlib import Path

import pytest
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsParticipant
from cyclonedds.core import Policy

from firstfix_fleet.dds.participant import Participant
from firstfix_lab.drills.weak_link.link import missing
from plugins.fleet.tests.robots.dds_world import scenes
from plugins.fleet.tests.robots.lossy_network import Told, ask, lossy_link, robot_over
from tests.claimed import any_domain
from tests.dds_loopback import LOOPBACK
from tests.recorded_data import HALL
from tests.waiting import wait_until

LOSS, ASKED, POINTS, WITHIN_M = 0.3, 3, 5000, 0.2
SHORT_LEASE_S = 10.0  # Cyclone DDS's own
OWN_S = 7.0
OWN = (
    f"<CycloneDDS><Domain><Discovery><LeaseDuration>{OWN_S} s</LeaseDuration>"
    "</Discovery></Domain></CycloneDDS>"
)


@pytest.mark.slow
def test_all_that_is_asked_is_answered_though_datagrams_are_lost(
    program: Path, hall_store: Path, tmp_path: Path
):
    reason = missing()
    if reason is not None:
        pytest.skip(reason)
    seen = scenes(HALL.write_queries(tmp_path / "poses.csv"), tmp_path, ASKED, points=POINTS)
    told = Told()
    with (
        lossy_link(LOSS, 0, told) as link,
        robot_over(link, program, tmp_path, hall_store, "hall") as robot,
    ):
        ask(robot, seen, told)
    assert len(told.far_m) == ASKED
    assert max(told.far_m) < WITHIN_M, told.far_m
    assert told.lost > LOSS / 2, "the link dropped less than it should"


def lease_s(participant: Participant) -> float:
    """The lease that a participant gives: for so long, others take it for alive after an announcement."""
    found: list[float] = []
    reader = BuiltinDataReader(participant.entity, BuiltinTopicDcpsParticipant)

    def look() -> list[float]:
        found.extend(one.qos[Policy.Liveliness].lease_duration / 1e9 for one in reader.take(10))
        return found

    wait_until(look)
    return found[0]


def test_the_gateway_outlasts_lost_announcements_unless_it_is_told_otherwise(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("CYCLONEDDS_URI", LOOPBACK)
    assert lease_s(Participant(any_domain())) > SHORT_LEASE_S
    monkeypatch.setenv("CYCLONEDDS_URI", f"{LOOPBACK},{OWN}")
    assert lease_s(Participant(any_domain())) == OWN_S

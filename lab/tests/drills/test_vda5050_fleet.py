"""A small fleet whose broker is killed once: ``firstfix-lab vda5050_fleet`` has 50 vehicles."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from vda5050.model import State
from vda5050.model.instant_actions import InstantActions
from vda5050.validation import SchemaValidator

from firstfix_fleet.vda5050.fix_seeker import MAX_TOPICS
from firstfix_lab.drills.vda5050_fleet import KINDS, vda5050_fleet
from firstfix_lab.drills.vda5050_silent import vda5050_silent
from plugins.fleet.tests.vda5050_vehicle import state

pytestmark = pytest.mark.slow


def test_every_lost_vehicle_is_initialised_or_named_and_none_while_it_drives(tmp_path: Path):
    figures = vda5050_fleet(tmp_path, vehicles=9, lost=len(KINDS), restarts=1, say=print)
    assert figures["exit_code"] == 0, (tmp_path / "gateway.log").read_text()
    for name in ("not_ended", "while_driving", "unasked", "wrong_pose"):
        assert not figures[name], name
    assert (figures["initialised"], figures["named"]) == (3, 3)
    schemas, versions = SchemaValidator(), set()
    for version, body in figures["bodies"]:
        message = json.loads(body)
        assert message["version"] == version
        versions.add(version)
        [action] = message["actions"]
        if version.startswith("2."):  # the package has no schemas of 3.0
            schemas.validate("instantActions", message)
            InstantActions.model_validate(message)
            assert (action["actionType"], action["blockingType"]) == ("initPosition", "HARD")
        else:
            assert (action["actionType"], action["blockingType"]) == ("initializePosition", "NONE")
    assert versions == {"2.0.0", "2.1.0", "3.0.0"}


def test_vehicles_that_send_no_scan_do_not_hold_up_one_that_does(tmp_path: Path):
    """All of them were lost before it: two rounds of topics would have to end before its turn."""
    figures = vda5050_silent(tmp_path, silent=70, say=print)
    assert figures["exit_code"] == 0, (tmp_path / "gateway.log").read_text()
    assert figures["given_up"] < MAX_TOPICS


def test_the_simulated_vehicles_speak_the_protocol():
    message = state(maps=[{"mapId": "HALL", "mapVersion": "7", "mapStatus": "ENABLED"}])
    SchemaValidator().validate("state", message)
    assert not State.model_validate(message).agv_position.position_initialized

"""Robots of a fleet are named to the service that answers them."""

from __future__ import annotations

from typing import Any

import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix_cli.answerer import answerer
from firstfix_ros.robot.answerer import of_robot
from tests.client.answer_server import ok
from tests.client.fake_answers import SCAN, answer_bytes


@pytest.mark.parametrize("name", ["/robot1", "KIT/agv-7"])
def test_the_service_is_told_which_robot_of_a_fleet_asks(server: Any, name: str):
    server.answers = [ok(answer_bytes())] * 3
    with answerer("hall", url=server.url, zenoh=None, store=None, timeout_s=10) as ask:
        for asking in (of_robot(ask, name), ask, of_robot(ask, "/a" * 40)):  # too long for a name
            asking(SCAN, LocalizeOptions())
    assert [request[3].get("x-robot") for request in server.requests] == [name, None, None]


def test_an_answerer_in_this_process_needs_no_name():
    def ask(scan: object, options: object) -> None:
        return None

    assert of_robot(ask, "/robot1") is ask

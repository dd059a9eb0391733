"""The form of an answer, by the Accept header."""

from __future__ import annotations

import pytest

from firstfix.errors import NotAcceptable
from firstfix.ros.media_types import POSE
from firstfix_service.query_workers.answer_form import GEOPOSE, AnswerForm
from tests.every_case import every_case


@every_case(
    "accept",
    [
        POSE,
        "application/vnd.ros2.cdr",
        "application/vnd.ros2.cdr; type=geometry_msgs/msg/PoseWithCovarianceStamped",
        "application/cdr;geometry_msgs/msg/PoseWithCovarianceStamped",
        f"text/html, {POSE}, */*;q=0.1",
        f"{POSE}, application/json;q=0.5",
        f"{POSE}, application/json",
    ],
)
def test_the_pose_message_is_wanted(accept):
    assert AnswerForm.of(accept, {}).pose is not None


@every_case(
    "accept",
    [
        "",
        "*/*",
        "application/json",
        "application/*",
        "application/geopose+json",
        "application/vnd.ros2.cdr; type=geometry_msgs/msg/PoseStamped",
        f"{POSE};q=0",
        f"{POSE};q=0.4, application/json;q=0.5",
        f"{POSE};q=nan",
        f"{POSE};q=much",
        ";;,,=;q",
    ],
)
def test_it_is_not(accept):
    assert AnswerForm.of(accept, {}).pose is None


@every_case(
    ("accept", "is_geographic"),
    [
        ("", False),
        ("*/*", False),
        (GEOPOSE, True),
        (f"{GEOPOSE}, application/json", False),
        (f"{GEOPOSE}, application/json;q=0.5", True),
        (f"{GEOPOSE};q=0.5, */*", False),
        ("application/*;q=0.2, application/json;q=0.1", True),
        (f"{GEOPOSE}, {POSE};q=nan", True),
    ],
)
def test_the_geographic_pose_where_it_is_offered(accept, is_geographic):
    assert AnswerForm.of(accept, {}, may_be_geographic=True).geographic is is_geographic
    assert not AnswerForm.of(accept, {}).geographic


@every_case("accept", ["text/html", f"{GEOPOSE};q=0", ";;,,=;q"])
def test_who_accepts_nothing_is_told_where_there_is_a_choice(accept):
    with pytest.raises(NotAcceptable):
        AnswerForm.of(accept, {}, may_be_geographic=True)
    assert AnswerForm.of(accept, {}) == AnswerForm()

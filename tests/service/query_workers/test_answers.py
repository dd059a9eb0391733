"""Answers: their form by the Accept header, and their JSON as workers encode it."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.answer.localization import Hypothesis, Localization, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.answer.scan_facts import ScanFacts
from firstfix.errors import NotAcceptable
from firstfix.findings.finding import Finding, Severity
from firstfix.ros.media_types import POSE
from firstfix.transform import make_transform, rotation_z
from firstfix_service.query_workers.answer_form import GEOPOSE, AnswerForm
from firstfix_service.query_workers.encoded_answer import encoded_answer, to_json
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
def test_a_pose_message_is_chosen(accept):
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
def test_no_pose_message_is_chosen(accept):
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
def test_a_geographic_pose_is_chosen_where_it_is_offered(accept, is_geographic):
    assert AnswerForm.of(accept, {}, may_be_geographic=True).geographic is is_geographic
    assert not AnswerForm.of(accept, {}).geographic


@every_case("accept", ["text/html", f"{GEOPOSE};q=0", ";;,,=;q"])
def test_an_accept_header_without_a_known_form_is_refused(accept):
    with pytest.raises(NotAcceptable):
        AnswerForm.of(accept, {}, may_be_geographic=True)
    assert AnswerForm.of(accept, {}) == AnswerForm()


T = make_transform(rotation_z(0.3), [1.5, -2.0, 0.1])
PLACE = Hypothesis(T, AlignmentQuality(0.9, 0.8, 0.01), 0.7, np.int64(3), "hall")  # type: ignore[arg-type]
BARE = Hypothesis(T, None, np.float64(0.2), 4)
ANSWER = Localization(
    Verdict.LOCALIZED,
    (),
    T,
    None,
    np.eye(6) * 1e-4,
    np.float64(0.7),
    (PLACE, BARE),
    "hall",
    "1" * 64,
    {"map": 0.1},
)
NAN = np.full((4, 4), np.nan)


def test_the_json_is_that_of_the_answer():
    assert json.loads(to_json(ANSWER)) == json.loads(json.dumps(ANSWER.to_mapping(), default=float))
    again = Localization.from_mapping(json.loads(encoded_answer(ANSWER).json))
    assert again.T_map_sensor is not None
    np.testing.assert_allclose(again.T_map_sensor, T, atol=1e-15)


@every_case(
    "broken",
    [
        replace(ANSWER, probability=float("nan")),
        replace(ANSWER, T_map_sensor=NAN),
        replace(ANSWER, T_map_base=NAN),
        replace(ANSWER, covariance=np.full((6, 6), np.inf)),
        replace(ANSWER, scan=ScanFacts(1, 1, 1, float("nan"))),
        replace(ANSWER, findings=(Finding("far", Severity.ERROR, "far", {"off_m": float("inf")}),)),
        replace(ANSWER, degenerate=(FreeDirection(Motion.ROTATION, np.full(3, np.nan), 1.0),)),
        replace(ANSWER, degenerate=(FreeDirection(Motion.ROTATION, np.ones(3), float("inf")),)),
        replace(ANSWER, hypotheses=(replace(PLACE, T_map_sensor=NAN),)),
        replace(ANSWER, hypotheses=(PLACE, replace(BARE, probability=float("inf")))),
        replace(ANSWER, hypotheses=(replace(PLACE, quality=AlignmentQuality(0.9, float("nan"), 0.01)),)),
        replace(
            ANSWER,
            hypotheses=(replace(PLACE, quality=AlignmentQuality(0.9, 0.8, 0.01, seen_free=float("nan"))),),
        ),
    ],
)
def test_a_number_that_is_not_finite_is_an_error(broken: Localization):
    with pytest.raises(ValueError, match="finite"):
        to_json(broken)


def test_the_pose_goes_along_only_for_geographic_answers():
    assert encoded_answer(ANSWER).T_map_body is None
    np.testing.assert_array_equal(encoded_answer(ANSWER, geographic=True).T_map_body, T)
    T_map_base = make_transform(rotation_z(1.0), [0, 0, 0])
    with_base = replace(ANSWER, T_map_base=T_map_base)
    np.testing.assert_array_equal(encoded_answer(with_base, geographic=True).T_map_body, T_map_base)

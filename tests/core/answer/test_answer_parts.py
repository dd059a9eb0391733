"""Parts of questions and answers: free directions, ids of fixes, priors and twists."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.errors import InvalidOption
from firstfix.native import FREE_M, FREE_RAD
from firstfix.transform import make_transform, rotation_z
from tests.reference.verdict_in_steps import free_directions

SURE = np.array([0.01, 0.01, 0.02, 0.001, 0.001, 0.002])


def covariance(deviation: np.ndarray, R: np.ndarray | None = None) -> np.ndarray:
    R = np.eye(3) if R is None else R
    turn = np.kron(np.eye(2), R)
    return turn @ np.diag(deviation**2) @ turn.T


def test_a_fixed_pose_has_no_free_direction():
    assert free_directions(covariance(SURE)) == ()
    at_limit = np.array([FREE_M] * 3 + [FREE_RAD] * 3) * 0.999
    assert free_directions(covariance(at_limit)) == ()


@pytest.mark.parametrize("seed", range(5))
def test_free_directions_are_found_along_any_axes(seed):
    R = Rotation.random(random_state=seed).as_matrix()
    deviation = np.array([0.5, 0.01, 1.5, 0.001, 0.3, 0.002])
    first, second, turn = free_directions(covariance(deviation, R))
    assert [one.motion for one in (first, second, turn)] == [Motion.TRANSLATION] * 2 + [Motion.ROTATION]
    assert [one.sigma for one in (first, second, turn)] == pytest.approx([1.5, 0.5, 0.3])
    for one, column in ((first, 2), (second, 0), (turn, 1)):
        assert abs(one.direction @ R[:, column]) == pytest.approx(1)
        assert one.direction[np.abs(one.direction).argmax()] > 0


def test_an_answer_carries_its_free_directions():
    free = free_directions(covariance(np.array([2.0, 0.01, 0.02, 0.001, 0.001, 0.1])))
    answer = Localization(Verdict.LOCALIZED, T_map_sensor=np.eye(4), degenerate=free)
    sent = json.loads(json.dumps(answer.to_mapping()))
    assert sent["degenerate"] == [
        {"motion": "translation", "direction": [1.0, 0.0, 0.0], "sigma": pytest.approx(2.0)},
        {"motion": "rotation", "direction": [0.0, 0.0, 1.0], "sigma": pytest.approx(0.1)},
    ]
    back = Localization.from_mapping(sent).degenerate
    assert [(one.motion, one.direction.tolist(), one.sigma) for one in back] == [
        (one.motion, one.direction.tolist(), one.sigma) for one in free
    ]


def test_an_older_service_tells_no_free_directions():
    sent = Localization(Verdict.LOCALIZED, T_map_sensor=np.eye(4)).to_mapping()
    assert sent.pop("degenerate") == []
    assert Localization.from_mapping(sent).degenerate == ()


@pytest.mark.parametrize(
    "damaged",
    [
        {"motion": "shear", "direction": [1, 0, 0], "sigma": 1},
        {"motion": "rotation", "direction": [1, 0], "sigma": 1},
        {"motion": "rotation", "sigma": 1},
    ],
)
def test_a_damaged_free_direction_is_refused(damaged):
    with pytest.raises((KeyError, ValueError)):
        FreeDirection.from_mapping(damaged)


def fix(x_m: float = 3.0, version: str = "ab" * 32, map_id: str = "hall") -> Localization:
    T = make_transform(rotation_z(0.1), [x_m, 4.0, 5.0])
    found = Localization(Verdict.LOCALIZED, T_map_sensor=T, covariance=np.eye(6))
    return found.of_version(map_id, version, provisional=False)


def test_a_fix_has_an_id_of_its_pose_and_version():
    assert len(fix().fix_id) == 16
    assert fix().fix_id == fix().fix_id
    assert Localization(Verdict.REJECTED).of_version("hall", "ab", provisional=False).fix_id == ""
    assert len({fix().fix_id, fix(3.0000001).fix_id, fix(version="cd" * 32).fix_id}) == 3


def test_the_id_of_a_fix_is_in_the_mapping_but_of_older_services():
    told = json.loads(json.dumps(fix().to_mapping()))
    assert Localization.from_mapping(told).fix_id == told["fix_id"] == fix().fix_id
    del told["fix_id"]
    assert Localization.from_mapping(told).fix_id == ""


def pose(x: float, yaw_deg: float = 0.0) -> np.ndarray:
    return make_transform(rotation_z(np.radians(yaw_deg)), [x, 0, 0])


def test_a_radius_allows_poses_within_it():
    prior = Prior(np.array([1.0, 0, 0]), 2.0)
    assert prior.allows(pose(2.9, 170))
    assert not prior.allows(pose(3.1))
    assert prior.allows(pose(3.1), slack_m=0.2)


@pytest.mark.parametrize(
    ("yaw_deg", "allowed"), [(160, True), (-170, True), (-161, True), (139, False), (0, False)]
)
def test_headings_of_a_prior_go_round(yaw_deg, allowed):
    prior = Prior(np.zeros(3), 5.0, yaw_deg=170.0, yaw_range_deg=30.0)
    assert prior.allows(pose(0, yaw_deg)) is allowed


TWIST = np.array([1.0, -0.25, 0.0, 0.0, 1e-3, 0.7])


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("prior", "1.0,2.0,3.0,4.0"),
        ("prior", "1.0,2.0,3.0,4.0,-90.0,15.0"),
        ("twist", "1.0,-0.25,0.0,0.0,0.001,0.7"),
    ],
)
def test_an_option_comes_back_as_its_text(name, text):
    assert LocalizeOptions.from_strings({name: text}).to_strings() == {name: text}
    assert np.array_equal(LocalizeOptions.from_strings({"twist": "1,-0.25,0,0,1e-3,0.7"}).twist, TWIST)
    assert LocalizeOptions.from_strings({}).twist is None


WRONG = {
    "prior": ["1,2,3", "1,2,3,0", "1,2,3,-1", "1,2,3,nan", "1,2,3,4,5", "1,2,3,4,0,0", "1,2,3,4,0,181", "x"],
    "twist": ["", "1,2,3", "1,2,3,4,5", "1,2,3,4,5,x", "101,0,0,0,0,0", "0,0,0,0,0,-21", "nan,0,0,0,0,0"],
}


@pytest.mark.parametrize(("name", "text"), [(name, text) for name, texts in WRONG.items() for text in texts])
def test_an_invalid_option_is_refused(name, text):
    with pytest.raises(InvalidOption, match=name):
        LocalizeOptions.from_strings({name: text})


def test_the_twist_of_an_answer_comes_back():
    answer = Localization(Verdict.LOCALIZED, T_map_sensor=np.eye(4), twist=TWIST)
    sent = answer.to_mapping()
    assert sent["twist"] == {"linear": [1.0, -0.25, 0.0], "angular": [0.0, 0.001, 0.7]}
    assert np.array_equal(Localization.from_mapping(sent).twist, TWIST)
    rejected = Localization(Verdict.REJECTED).to_mapping()
    assert rejected["twist"] is None
    del rejected["twist"]  # as a service before this one
    assert Localization.from_mapping(rejected).twist is None

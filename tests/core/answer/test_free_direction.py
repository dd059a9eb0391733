"""Free directions: which ones a covariance has, and their way through JSON."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.answer.free_direction import FREE_M, FREE_RAD, FreeDirection, Motion, free_directions
from firstfix.answer.localization import Localization, Verdict

SURE = np.array([0.01, 0.01, 0.02, 0.001, 0.001, 0.002])


def covariance(deviation: np.ndarray, R: np.ndarray | None = None) -> np.ndarray:
    R = np.eye(3) if R is None else R
    turn = np.kron(np.eye(2), R)
    return turn @ np.diag(deviation**2) @ turn.T


def test_a_fixed_pose_has_none():
    assert free_directions(covariance(SURE)) == ()
    at_limit = np.array([FREE_M] * 3 + [FREE_RAD] * 3) * 0.999
    assert free_directions(covariance(at_limit)) == ()


@pytest.mark.parametrize("seed", range(5))
def test_each_is_found_along_any_direction(seed):
    R = Rotation.random(random_state=seed).as_matrix()
    deviation = np.array([0.5, 0.01, 1.5, 0.001, 0.3, 0.002])
    first, second, turn = free_directions(covariance(deviation, R))
    assert [one.motion for one in (first, second, turn)] == [Motion.TRANSLATION] * 2 + [Motion.ROTATION]
    assert [one.sigma for one in (first, second, turn)] == pytest.approx([1.5, 0.5, 0.3])
    for one, column in ((first, 2), (second, 0), (turn, 1)):
        assert abs(one.direction @ R[:, column]) == pytest.approx(1)
        assert one.direction[np.abs(one.direction).argmax()] > 0


def test_an_answer_carries_them():
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


def test_an_older_service_does_not_tell():
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
def test_a_damaged_one_is_refused(damaged):
    with pytest.raises((KeyError, ValueError)):
        FreeDirection.from_mapping(damaged)

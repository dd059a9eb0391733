"""The id of a fix: the same for the same pose in the same version."""

from __future__ import annotations

import json

import numpy as np

from firstfix.answer.localization import Localization, Verdict
from firstfix.transform import make_transform, rotation_z


def fix(x_m: float = 3.0, version: str = "ab" * 32, map_id: str = "hall") -> Localization:
    T = make_transform(rotation_z(0.1), [x_m, 4.0, 5.0])
    found = Localization(Verdict.LOCALIZED, T_map_sensor=T, covariance=np.eye(6))
    return found.of_version(map_id, version, provisional=False)


def test_the_same_fix_has_the_same_id_and_another_one_another():
    assert len(fix().fix_id) == 16
    assert fix().fix_id == fix().fix_id
    assert len({fix().fix_id, fix(3.0000001).fix_id, fix(version="cd" * 32).fix_id}) == 3


def test_it_is_in_the_answers_mapping_and_older_services_do_not_tell():
    told = json.loads(json.dumps(fix().to_mapping()))
    assert Localization.from_mapping(told).fix_id == told["fix_id"] == fix().fix_id
    del told["fix_id"]
    assert Localization.from_mapping(told).fix_id == ""


def test_without_a_pose_there_is_none():
    assert Localization(Verdict.REJECTED).of_version("hall", "ab", provisional=False).fix_id == ""

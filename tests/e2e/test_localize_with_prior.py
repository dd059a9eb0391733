"""A prior on a real version restricts what is compared and what is answered."""

from dataclasses import fields, replace

import numpy as np
import pytest

from firstfix.answer.localization import Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import pose_error, yaw_of


@pytest.fixture(scope="module")
def index(small_version):
    return MapIndex.load(small_version.directory)


def test_a_right_prior_keeps_the_answer(index, small_scans):
    localizer = Localizer(index)
    for scan, T_map_sensor in small_scans[:8]:
        free = localizer.localize(scan)
        prior = Prior(T_map_sensor[:3, 3], 1.5, np.degrees(yaw_of(T_map_sensor)), 20.0)
        answer = localizer.localize(scan, LocalizeOptions(prior=prior))
        if free.hypotheses and pose_error(T_map_sensor, free.hypotheses[0].T_map_sensor)[0] < 0.1:
            assert pose_error(T_map_sensor, answer.hypotheses[0].T_map_sensor)[0] < 0.1


def test_no_answer_lies_outside_a_wrong_prior(index, small_scans):
    localizer = Localizer(index)
    for scan, T_map_sensor in small_scans[:8]:
        other = np.array([-np.sign(T_map_sensor[0, 3]) * 5.0, 0.0, T_map_sensor[2, 3]])
        prior = Prior(other, 2.0)
        for hypothesis in localizer.localize(scan, LocalizeOptions(prior=prior)).hypotheses:
            assert prior.allows(hypothesis.T_map_sensor)


def test_a_prior_off_the_map_has_no_candidate(index, small_scans):
    prior = Prior(np.array([500.0, 0, 0]), 3.0)
    answer = Localizer(index).localize(small_scans[0][0], LocalizeOptions(prior=prior))
    assert (answer.verdict, answer.reasons) == (Verdict.REJECTED, (Reason.NO_CANDIDATE,))


def test_a_small_radius_compares_only_the_templates_in_it(index, small_scans):
    compared = []
    cascade = index.cascade

    class Counting(type(cascade)):
        def compare(self, described, rows):
            compared.append(rows)
            return super().compare(described, rows)

    counting = Counting(**{field.name: getattr(cascade, field.name) for field in fields(cascade)})
    scan, T_map_sensor = small_scans[0]
    for radius_m in (1.5, 1e3):
        options = LocalizeOptions(prior=Prior(T_map_sensor[:3, 3], radius_m))
        Localizer(replace(index, cascade=counting)).localize(scan, options)
    near, everywhere = compared
    away_m = np.linalg.norm(cascade.templates.position_m[near] - T_map_sensor[:3, 3], axis=1)
    assert away_m.max() <= 1.5 + index.config.spacing_m
    assert len(near) < len(everywhere)

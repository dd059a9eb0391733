"""Poses that the search for candidates returns, and when it runs a second time."""

from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import PerturbConfig
from firstfix.engine.candidates import MAX_PER_SPOT, SPOT_DEG, SPOT_M, find_candidates
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.preprocess import preprocess
from firstfix.scan.sequence import ScanSequence
from firstfix.sensor import SensorModel
from firstfix.transform import pose_error
from firstfix_builder.simulation.perturb import elsewhere, perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from tests.small_world import SENSOR


@pytest.fixture(scope="module")
def index(small_version):
    return MapIndex.load(small_version.directory)


@pytest.fixture(scope="module")
def foreign_scan():
    rng = np.random.default_rng(15)
    spots = np.column_stack([rng.uniform(-12, 12, (50, 2)), np.full(50, 0.8)])
    sensor = SensorModel.from_mapping(SENSOR)
    return perturbed_scans(Simulator(*elsewhere(rng)), sensor, spots, 1.0, 1, PerturbConfig(), rng)[0][0]


def proposed(index, scan, effort=1, options=None):
    prepared = preprocess(ScanSequence.single(scan), None, index.config.preprocess)
    described = [one.described_by(index.cascade.descriptor) for one in prepared.scans]
    return find_candidates(index, described, prepared.scans, options or LocalizeOptions(), effort)


def test_no_spot_crowds_out_the_others(index, small_scans):
    for scan, _ in small_scans[:6]:
        poses = list(proposed(index, scan).T_level_sensor)
        assert 3 <= len(poses) <= index.config.search.candidates
        for last, pose in enumerate(poses):
            errors = [pose_error(pose, earlier) for earlier in poses[:last]]
            beside = sum(metres < SPOT_M - 1e-6 and degrees < SPOT_DEG for metres, degrees in errors)
            assert beside < MAX_PER_SPOT


def test_more_effort_proposes_more_and_loses_none(index, small_scans):
    few = proposed(index, small_scans[0][0])
    many = proposed(index, small_scans[0][0], effort=2)
    assert len(many) > len(few)
    of_few = set(few.template.tolist())
    # what more keys bring may come before some of them, but their order stays
    assert [row for row in many.template.tolist() if row in of_few] == few.template.tolist()


def searched(index) -> tuple[Localizer, list[int]]:
    """Returns a localizer, and a list of the clusters that its searches ask for."""
    asked: list[int] = []

    class Telling(type(index.cascade)):
        def search(self, described, clusters):
            asked.append(clusters)
            return super().search(described, clusters)

    cascade = index.cascade
    telling = Telling(**{field.name: getattr(cascade, field.name) for field in fields(cascade)})
    return Localizer(replace(index, cascade=telling)), asked


def test_a_convincing_answer_is_searched_for_once(index, small_scans):
    localizer, asked = searched(index)
    accepted = next(
        scan for scan, _ in small_scans if Localizer(index).localize(scan).verdict is Verdict.LOCALIZED
    )
    localizer.localize(accepted)
    assert asked == [index.config.search.clusters]


def test_another_is_searched_for_step_by_step(index, foreign_scan):
    localizer, asked = searched(index)
    assert localizer.localize(foreign_scan).verdict is not Verdict.LOCALIZED
    search = index.config.search
    steps = [asked[0], *(b for a, b in pairwise(asked) if a != b)]
    ups, wide, last = steps[2], steps[1] * asked.count(steps[1]), steps[3] * asked.count(steps[3])
    assert steps[0] == ups == search.clusters
    assert search.wide.clusters * 0.9 <= wide <= search.wide.clusters, "shared by the ways to level the scan"
    assert search.exhaustive.clusters * 0.9 <= last <= search.exhaustive.clusters


def test_a_version_may_forbid_the_later_steps(index, foreign_scan):
    config = index.config
    search = config.search.model_copy(update={"widened": 1})
    localizer, asked = searched(replace(index, config=config.model_copy(update={"search": search})))
    localizer.localize(foreign_scan)
    assert set(asked) == {search.clusters}


def test_who_limits_the_candidates_is_not_overruled(index, foreign_scan):
    localizer, asked = searched(index)
    localizer.localize(foreign_scan, LocalizeOptions(max_candidates=5))
    assert set(asked) == {index.config.search.clusters}
    assert len(proposed(index, foreign_scan, options=LocalizeOptions(max_candidates=5))) <= 5

"""Scans that were taken in motion, on a real version and in every encoding."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import PerturbConfig
from firstfix.decode import decode_query
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import InvalidOption
from firstfix.scan.condense import condense, describe
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.sensor import SensorModel
from firstfix.transform import make_transform, pose_error
from firstfix.wire import query as wire_query
from firstfix.wire import scan as wire
from firstfix.wire import sequence as wire_sequence
from firstfix_builder.simulation.moving import Motion
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.simulate import Simulator
from tests.small_world import SENSOR

TWIST = (1.0, 0.2, 0.0, 0.0, 0.0, 1.5)
CASES = 12


@pytest.fixture(scope="module")
def localizer(small_version):
    return Localizer(MapIndex.load(small_version.directory))


@pytest.fixture(scope="module")
def moving(small_world, localizer) -> list[tuple[Scan, np.ndarray]]:
    """Scans with times and where they were taken."""
    simulator = Simulator(small_world.vertices, small_world.triangles)
    simulation = ScanSimulation(simulator, SensorModel.from_mapping(SENSOR), PerturbConfig(occluders=2))
    at = localizer.index.cascade.templates.position_m
    cases = simulation.cases(at, 1.0, CASES, np.random.default_rng(21))
    return [(simulation.scan(case, Motion(TWIST)), case.T_level_sensor) for case in cases]


def errors(answers: list[Localization], moving) -> np.ndarray:
    """Metres and degrees (n, 2) of those that are localized."""
    found = zip(answers, moving, strict=True)
    return np.array([pose_error(a.T_map_sensor, T) for a, (_, T) in found if a.verdict is Verdict.LOCALIZED])


def test_the_motion_is_in_the_answer_and_the_pose_is_better(localizer, moving):
    timed = [localizer.localize(scan) for scan, _ in moving]
    still = [localizer.localize(replace(scan, time_s=None)) for scan, _ in moving]
    metres, degrees = np.median(errors(timed, moving), axis=0)
    assert metres < 0.02
    assert degrees < 0.15
    first = [pose_error(a.hypotheses[0].T_map_sensor, T) for a, (_, T) in zip(still, moving, strict=True)]
    rigid_m, rigid_deg = np.median([one for one in first if one[0] < 1], axis=0)
    assert metres < rigid_m / 2
    assert degrees < rigid_deg / 2
    localized = [sum(a.verdict is Verdict.LOCALIZED for a in answers) for answers in (timed, still)]
    assert localized[0] >= max(CASES * 2 // 3, localized[1])
    assert errors(timed, moving)[:, 0].max() < 0.2
    for answer in timed:
        assert (answer.twist is not None) == (answer.verdict is Verdict.LOCALIZED)
    off = [answer.twist - TWIST for answer in timed if answer.twist is not None]
    assert np.median(np.abs(off), axis=0).max() < 0.15
    assert all(answer.twist is None for answer in still)


def test_every_encoding_carries_the_motion(localizer, moving):
    def by(encode) -> list[Localization]:
        return [localizer.localize(decode_query(*encode(scan))) for scan, _ in moving]

    def in_sequence(scan):
        return wire_sequence.encode_scans([scan], [np.eye(4)]), wire_sequence.MEDIA_TYPE

    for encode in (
        lambda scan: (wire.encode_scan(scan), wire.MEDIA_TYPE),
        lambda scan: (wire.encode_scan(scan, form="range_image"), wire.MEDIA_TYPE),
        lambda scan: (wire_query.encode_query(condense(scan)), wire_query.MEDIA_TYPE),
        in_sequence,
    ):
        answers = by(encode)
        assert sum(answer.twist is not None for answer in answers) >= 2 * CASES // 3
        metres, degrees = np.median(errors(answers, moving), axis=0)
        assert metres < 0.03
        assert degrees < 0.2


def test_a_known_motion_is_taken_as_it_is(localizer, moving):
    options = LocalizeOptions(twist=np.array(TWIST))
    answers = [localizer.localize(scan, options) for scan, _ in moving]
    metres, degrees = np.median(errors(answers, moving), axis=0)
    assert metres < 0.02
    assert degrees < 0.15
    assert all(np.array_equal(answer.twist, TWIST) for answer in answers if answer.T_map_sensor is not None)


def test_a_known_motion_needs_times(localizer, moving, small_version):
    scan, options = moving[0][0], LocalizeOptions(twist=np.array(TWIST))
    parameters = DescriptorParameters.from_engine(small_version.manifest.engine)
    for without in (
        replace(scan, time_s=None),
        condense(replace(scan, time_s=None)),
        describe(scan, parameters),
    ):
        with pytest.raises(InvalidOption, match="times"):
            localizer.localize(without, options)


def test_the_motion_in_a_sequence_is_that_of_its_last_scan(small_world, localizer, moving):
    _, T = moving[0]
    simulator = Simulator(small_world.vertices, small_world.triangles)
    simulation = ScanSimulation(simulator, SensorModel.from_mapping(SENSOR), PerturbConfig(occluders=0))
    case = simulation.cases(T[None, :3, 3], 0.1, 1, np.random.default_rng(2))[0]
    before = replace(case, T_level_sensor=case.T_level_sensor @ make_transform(np.eye(3), [-0.1, 0, 0]))
    scans = [simulation.scan(before), simulation.scan(case, Motion(TWIST))]
    body = wire_sequence.encode_scans(scans, [before.T_level_sensor, case.T_level_sensor])
    query = decode_query(body, wire_sequence.MEDIA_TYPE)
    answer = localizer.localize(query, LocalizeOptions(min_probability=0.9))
    assert pose_error(answer.T_map_sensor, case.T_level_sensor)[0] < 0.03
    assert np.abs(answer.twist - TWIST).max() < 0.4


def test_times_that_are_all_the_same_are_no_motion(localizer, moving):
    scan = moving[0][0]
    flash = replace(scan, time_s=np.full(len(scan), 0.01, np.float32))
    still = localizer.localize(replace(scan, time_s=None))
    found = localizer.localize(flash)
    assert found.twist is None
    assert np.array_equal(found.hypotheses[0].T_map_sensor, still.hypotheses[0].T_map_sensor)

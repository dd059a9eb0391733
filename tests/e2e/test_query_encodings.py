"""Queries in every encoding on a real version: compact, range images, sequences, scans in motion."""

from __future__ import annotations

import io
from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.builds.config import PerturbConfig
from firstfix.decode import decode_query
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.engine.localizer import localize_among
from firstfix.errors import DescriptorMismatch, InvalidOption
from firstfix.scan.compact import CompactScan
from firstfix.scan.condense import condense, describe
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.scan_formats import ROWS
from firstfix.sensor import SensorModel
from firstfix.transform import inverse, make_transform, pose_error, rotation_z
from firstfix.wire import query as wire_query
from firstfix.wire import scan as wire
from firstfix.wire import sequence as wire_sequence
from firstfix.wire.query import MEDIA_TYPE, encode_query
from firstfix_builder.simulation.moving import Motion
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.simulate import Simulator
from tests.core.formats.cloud_files import pcd, ply
from tests.hostile_bodies import npy
from tests.ros_samples import cdr, cloud_of_points
from tests.small_world import SENSOR


def sent(query):
    return decode_query(encode_query(query), MEDIA_TYPE)


def test_a_compact_query_is_answered_like_its_scan(localizer, parameters, small_scans):
    right = {"scan": 0, "any map": 0, "this map": 0}
    for scan, T_map_sensor in small_scans:
        whole = localizer.localize(scan)
        for name, known in (("any map", None), ("this map", parameters)):
            body = encode_query(condense(scan, known))
            assert len(body) < 10_000
            answer = localizer.localize(decode_query(body, MEDIA_TYPE))
            right[name] += is_right(answer, T_map_sensor)
            if whole.T_map_sensor is not None and answer.T_map_sensor is not None:
                metres, degrees = pose_error(whole.T_map_sensor, answer.T_map_sensor)
                assert metres < 0.05
                assert degrees < 0.5
        right["scan"] += is_right(whole, T_map_sensor)
    assert right["scan"] >= 15
    assert right["any map"] >= right["scan"] - 1
    assert right["this map"] >= right["scan"] - 1


def is_right(answer: Localization, T_map_sensor) -> bool:
    return answer.T_map_sensor is not None and pose_error(T_map_sensor, answer.T_map_sensor)[0] < 0.2


def test_one_scan_has_one_probability_in_every_file_format(localizer, small_scans):
    """Exact formats give the same answer to the last bit; whole millimetres the same but for .02."""
    for scan, _ in [*small_scans[:4], (near_part(small_scans[5][0]), None)]:
        points = np.ascontiguousarray(scan.points)
        record = np.zeros(len(points), [(axis, "<f4") for axis in "xyz"])
        record["x"], record["y"], record["z"] = points.T
        exact = {
            "xyz": ("application/vnd.firstfix.xyz", points.tobytes()),
            "npy": ("", npy(points)),
            "npy of doubles": ("", npy(points.astype(np.float64))),
            **{f"pcd {form}": ("", pcd(record, form)) for form in ("ascii", "binary", "binary_compressed")},
            "ply": ("", ply(record, "binary_little_endian")),
            "csv": ("", csv_of(points, "%.9g")),
            "rows": (ROWS, np.c_[points, np.ones(len(points))].astype("<f4").tobytes()),
            "cloud": ("", cdr(cloud_of_points(points))),
        }
        whole = localizer.localize(scan)
        for name, (media_type, body) in exact.items():
            answer = localizer.localize(decode_query(body, media_type))
            assert (answer.verdict, answer.probability) == (whole.verdict, whole.probability), name
            assert len(answer.hypotheses) == len(whole.hypotheses), name
            for one, other in zip(answer.hypotheses, whole.hypotheses, strict=True):
                np.testing.assert_array_equal(one.T_map_sensor, other.T_map_sensor)
        rounded = localizer.localize(decode_query(csv_of(points, "%.3f"), ""))
        if rounded.verdict is whole.verdict:
            assert rounded.probability == pytest.approx(whole.probability, abs=0.02)


def near_part(scan: Scan) -> Scan:
    return Scan(scan.points[np.linalg.norm(scan.points, axis=1) < 5])


def csv_of(points, form: str) -> bytes:
    file = io.BytesIO()
    np.savetxt(file, points, fmt=form, delimiter=",", header="x,y,z", comments="")
    return file.getvalue()


def test_a_descriptor_alone_gives_candidates_without_a_pose(localizer, parameters, small_scans):
    claimed, first, found = [], 0, 0
    for scan, T_map_sensor in small_scans:
        body = encode_query(describe(scan, parameters))
        assert len(body) < 1500
        answer = localizer.localize(decode_query(body, MEDIA_TYPE), LocalizeOptions(min_probability=0.0))
        assert answer.verdict is Verdict.AMBIGUOUS, "whatever the caller asks for"
        assert answer.reasons == (Reason.NOT_REGISTERED,)
        assert answer.T_map_sensor is None
        assert answer.covariance is None
        errors = [pose_error(T_map_sensor, h.T_map_sensor) for h in answer.hypotheses]
        near = [metres < 1.5 and degrees < 15 for metres, degrees in errors]
        first, found = first + near[0], found + any(near)
        probabilities = [h.probability for h in answer.hypotheses]
        assert probabilities == sorted(probabilities, reverse=True)
        assert answer.probability == probabilities[0]
        claimed.append(answer.probability)
        assert Localization.from_mapping(answer.to_mapping()).hypotheses[0].quality is None
    assert found >= 19
    assert abs(np.mean(claimed) - first / len(small_scans)) < 0.25


def test_a_prior_holds_for_candidates(localizer, parameters, small_scans):
    scan, T_map_sensor = small_scans[0]
    prior = Prior(T_map_sensor[:3, 3], 1.5)
    answer = localizer.localize(sent(describe(scan, parameters)), LocalizeOptions(prior=prior))
    assert answer.hypotheses
    assert all(prior.allows(h.T_map_sensor, slack_m=1.0) for h in answer.hypotheses)
    nowhere = Prior(np.array([500.0, 0, 0]), 1.0)
    refused = localizer.localize(sent(describe(scan, parameters)), LocalizeOptions(prior=nowhere))
    assert (refused.verdict, refused.reasons) == (Verdict.REJECTED, (Reason.NO_CANDIDATE,))


def test_maps_compete_for_a_descriptor(localizer, parameters, small_scans):
    answer = localize_among(
        {"one": localizer, "two": localizer}, sent(describe(small_scans[0][0], parameters))
    )
    assert {h.map_id for h in answer.hypotheses[:2]} == {"one", "two"}
    assert answer.probability < 0.5, "two maps explain it equally well"


def test_a_descriptor_of_another_map_is_refused(localizer, parameters, small_scans):
    other = replace(parameters, descriptor=LayeredOccupancy(PolarGrid(20, 60, 77.0)))
    with pytest.raises(DescriptorMismatch, match="manifest"):
        localizer.localize(sent(describe(small_scans[0][0], other)))


def test_points_make_up_for_a_descriptor_of_another_map(localizer, parameters, small_scans):
    other = replace(parameters, descriptor=LayeredOccupancy(PolarGrid(20, 60, 77.0)))
    scan, T_map_sensor = next(
        (scan, T) for scan, T in small_scans if is_right(localizer.localize(sent(condense(scan))), T)
    )
    assert is_right(localizer.localize(sent(condense(scan, other))), T_map_sensor)


def test_too_few_points_are_rejected_like_a_scans(localizer):
    answer = localizer.localize(sent(condense(Scan.from_points(np.zeros((3, 3))))))
    assert (answer.verdict, answer.reasons) == (Verdict.REJECTED, (Reason.TOO_FEW_POINTS,))


def test_compact_scans_make_a_sequence(localizer, small_scans):
    (first, T_map_first), (last, T_map_last) = small_scans[:2]
    scans = [sent(condense(first)), sent(condense(last))]
    assert all(isinstance(scan, CompactScan) for scan in scans)
    T_first_last = inverse(T_map_first) @ T_map_last
    answer = localizer.localize(ScanSequence.along(scans, [np.eye(4), T_first_last]))
    assert is_right(answer, T_map_last)


def test_a_range_image_is_answered_like_its_scan(localizer, small_scans):
    right = {"scan": 0, "range image": 0}
    for scan, T_map_sensor in small_scans:
        body = wire.encode_scan(scan, form="range_image")
        assert len(body) < len(wire.encode_scan(scan)) / 2
        whole, image = localizer.localize(scan), localizer.localize(decode_query(body, wire.MEDIA_TYPE))
        for name, answer in (("scan", whole), ("range image", image)):
            right[name] += is_right(answer, T_map_sensor)
        if whole.T_map_sensor is not None and image.T_map_sensor is not None:
            metres, degrees = pose_error(whole.T_map_sensor, image.T_map_sensor)
            assert metres < 0.05
            assert degrees < 0.5
    assert right["scan"] >= 15
    assert right["range image"] >= right["scan"] - 1


def way_of(scans):
    """Returns the true poses in the frame of an odometry."""
    start = make_transform(rotation_z(0.7), [40.0, -3.0, 1.0])
    return [start @ inverse(scans[0][1]) @ T for _, T in scans]


def test_three_scans_give_the_pose_of_the_last(localizer, small_scans):
    for first in range(0, 12, 3):
        part = small_scans[first : first + 3]
        answer = localizer.localize(ScanSequence.along([s for s, _ in part], way_of(part)))
        off_m, off_deg = pose_error(part[-1][1], answer.hypotheses[0].T_map_sensor)
        assert off_m < 0.1
        assert off_deg < 1


def test_more_scans_localize_more_often(localizer, small_scans):
    alone = sum(localizer.localize(s).verdict is Verdict.LOCALIZED for s, _ in small_scans[:12])
    together = sum(
        localizer.localize(
            ScanSequence.along([s for s, _ in small_scans[n : n + 3]], way_of(small_scans[n : n + 3]))
        ).verdict
        is Verdict.LOCALIZED
        for n in range(12)
    )
    assert together >= alone


def test_an_empty_scan_does_not_spoil_a_sequence(localizer, small_scans):
    (seen, T_map_sensor), nothing = small_scans[0], Scan(np.zeros((0, 3), np.float32))
    answer = localizer.localize(ScanSequence.along([seen, nothing], [np.eye(4), np.eye(4)]))
    assert pose_error(T_map_sensor, answer.hypotheses[0].T_map_sensor)[0] < 0.1


def test_an_encoded_sequence_is_answered(localizer, small_scans):
    part = small_scans[3:5]
    for form in ("points", "range_image"):
        body = wire_sequence.encode_scans([s for s, _ in part], way_of(part), form=form)
        answer = localizer.localize(decode_query(body, wire_sequence.MEDIA_TYPE))
        assert pose_error(part[-1][1], answer.hypotheses[0].T_map_sensor)[0] < 0.1


TWIST = (1.0, 0.2, 0.0, 0.0, 0.0, 1.5)
CASES = 12


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


def test_a_known_motion_is_not_estimated(localizer, moving):
    options = LocalizeOptions(twist=np.array(TWIST))
    answers = [localizer.localize(scan, options) for scan, _ in moving]
    metres, degrees = np.median(errors(answers, moving), axis=0)
    assert metres < 0.02
    assert degrees < 0.15
    assert all(np.array_equal(answer.twist, TWIST) for answer in answers if answer.T_map_sensor is not None)


def test_a_known_motion_needs_times(localizer, moving, parameters):
    scan, options = moving[0][0], LocalizeOptions(twist=np.array(TWIST))
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


def test_equal_times_are_no_motion(localizer, moving):
    scan = moving[0][0]
    flash = replace(scan, time_s=np.full(len(scan), 0.01, np.float32))
    still = localizer.localize(replace(scan, time_s=None))
    found = localizer.localize(flash)
    assert found.twist is None
    assert np.array_equal(found.hypotheses[0].T_map_sensor, still.hypotheses[0].T_map_sensor)

"""Compact queries on a real version are as good as scans; descriptors give candidates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.decode import decode_query
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.errors import DescriptorMismatch
from firstfix.scan.compact import CompactScan
from firstfix.scan.condense import condense, describe
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import inverse, pose_error
from firstfix.wire.query import MEDIA_TYPE, encode_query


@pytest.fixture(scope="module")
def localizer(small_version):
    return Localizer(MapIndex.load(small_version.directory))


@pytest.fixture(scope="module")
def parameters(small_version):
    return DescriptorParameters.from_engine(small_version.manifest.engine)


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


def test_a_descriptor_alone_gives_candidates_and_says_so(localizer, parameters, small_scans):
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


def test_a_descriptor_of_another_map_is_told_so(localizer, parameters, small_scans):
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

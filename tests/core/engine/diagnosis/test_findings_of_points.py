"""The facts of a scan, and the causes that they show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.answer.scan_facts import ScanFacts
from firstfix.answer.time_findings import no_times_finding, time_field_finding, with_time_field
from firstfix.engine.config import PreprocessConfig
from firstfix.engine.diagnosis.facts import MEASURED, facts_of, is_on_a_line
from firstfix.engine.diagnosis.input_findings import input_finding
from firstfix.engine.diagnosis.other_forms import MAX_SCALE, MIN_SCALE, from_polar, scales
from firstfix.errors import InvalidOption, InvalidScan
from firstfix.findings import scan_kinds
from firstfix.findings.finding import Finding, Severity
from firstfix.findings.registry import KINDS
from firstfix.formats.point_cloud import PointCloud
from firstfix.scan.reduction import at_most
from firstfix.scan.scan import Dropped, Scan
from firstfix.scan_file import scan_of_cloud
from firstfix.sensor import preset

RNG = np.random.default_rng(5)
LIMITS = PreprocessConfig()
NONE = np.empty((0, 3), np.float32)


def room(sensor: str = "vlp-16") -> np.ndarray:
    """Points of a sensor in a box of 16 x 10 x 4 m, 1 m above its floor."""
    rays = preset(sensor).directions().astype(np.float64)
    rays[np.abs(rays) < 1e-9] = 1e-9
    walls = np.where(rays > 0, [8.0, 5.0, 3.0], [-8.0, -5.0, -1.0]) / rays
    return rays * walls.min(axis=1)[:, None]


def found(points: np.ndarray) -> Finding | None:
    scan = Scan.from_points(points)
    return input_finding(facts(scan), at_most(scan.points, MEASURED), scan.dropped)


def facts(scan: Scan) -> ScanFacts:
    return facts_of(scan, at_most(scan.points, MEASURED), scan.dropped, LIMITS)


def test_facts_of_a_scan():
    points = np.concatenate([room(), np.full((100, 3), np.nan), np.full((50, 3), 5e3), np.zeros((20, 3))])
    scan = Scan.from_points(points, time_s=np.linspace(0, 0.1, len(points)))
    told = facts(scan)
    assert (told.points, told.valid) == (len(points), len(points) - 150)
    assert told.in_range == len(room())
    assert 4 < told.median_range_m < 9
    assert told.largest_range_m == pytest.approx(np.linalg.norm(room(), axis=1).max(), abs=0.5)
    assert told.rings == 16
    assert told.plane_ratio > 0.05
    assert told.time_span_s == pytest.approx(0.1, abs=0.01)
    assert ScanFacts.from_mapping(told.to_mapping()) == told


def test_right_scans_have_no_cause():
    for sensor in ("vlp-16", "os0-64", "hdl-64e"):
        points = room(sensor)
        assert found(points) is None
        some = np.where(RNG.random((len(points), 1)) < 0.8, np.nan, points)  # beams without a return
        assert found(some) is None


def test_a_wrong_unit_is_named_by_the_median_range():
    for factor, code in {1000: "unit_millimetres", 100: "unit_centimetres", 0.01: "all_too_near"}.items():
        assert found(room() * factor).code == code
    assert found(room() + [450_000, 5_200_000, 300]).code == "map_coordinates"


def test_invalid_points_are_counted():
    nothing = found(room() * np.nan)
    assert nothing.code == "nothing_valid"
    assert nothing.numbers["not_finite"] == len(room())
    assert f"{len(room()):,}" in nothing.text
    assert found(room() * 0).numbers["zero"] == len(room())
    assert found(room()[:0]).code == "scan_empty"


def test_points_dropped_by_the_robot_are_sent_to_the_service():
    dropped = Scan.from_points(room() * 1000).dropped
    sent = LocalizeOptions.from_strings(LocalizeOptions(dropped=dropped).to_strings())
    assert sent.dropped == dropped
    assert dropped.too_far > 0.9 * len(room())
    with pytest.raises(InvalidOption, match="below 0"):
        LocalizeOptions.from_strings({"dropped": "1,-1,0,0"})
    told = input_finding(ScanFacts(8000, 0, 0, 6e3), NONE, Dropped(0, 8000, 6e3, 6e3))
    assert told.code == "unit_millimetres"


def test_a_transposed_array_is_no_scan():
    with pytest.raises(InvalidScan, match="transpose"):
        Scan.from_points(room().T)


def test_polar_numbers_become_points():
    points = room().astype(np.float32)
    range_m = np.linalg.norm(points, axis=1)
    angles = [np.arctan2(points[:, 1], points[:, 0]), np.arcsin(points[:, 2] / range_m)]
    for unit in (1.0, 180 / np.pi):
        polar = np.column_stack([range_m, *(unit * angle for angle in angles)]).astype(np.float32)
        np.testing.assert_allclose(from_polar(polar), points, atol=1e-4)
    assert from_polar(points) is None


@pytest.mark.parametrize("height_m", [None, 0.0, 1e-300, 1e-9, 1.0, 1e300])
@pytest.mark.parametrize("usual_height_m", [0.0, 1e-300, 1e-9, 1.0, 1e300])
def test_any_heights_give_scales_that_may_be_tried(height_m, usual_height_m):
    tried = [factor for factor, _ in scales(height_m, usual_height_m)]
    assert 0.3048 in tried
    assert all(MIN_SCALE < factor < MAX_SCALE for factor in tried)


def test_scales_begin_with_that_of_the_height():
    assert next(scales(2.5, 1.0))[0] == pytest.approx(0.4)
    assert next(scales(3.28, 1.0)) == (0.3048, "feet")
    tried = [factor for factor, _ in scales(None, 1.0)]
    assert len(tried) == len(set(tried))


def test_every_kind_of_finding_is_complete():
    assert len(KINDS) > 20
    for code, kind in KINDS.items():
        assert kind.code == code
        assert kind.text.endswith((".", "?"))
        assert all((kind.symptom, kind.remedy, kind.doc)), code
        assert kind.severity in Severity


def test_an_array_3_n_lies_on_a_line_and_parts_of_a_turn_do_not():
    for sensor in ("vlp-16", "os0-64", "osdome-64", "mid-360"):
        points = room(sensor).astype(np.float32)
        assert is_on_a_line(at_most(points[: len(points) // 3 * 3].T.copy().reshape(-1, 3), MEASURED)), sensor
        azimuth_deg = np.degrees(np.arctan2(points[:, 1], points[:, 0]))
        for heading_deg in (-135, 45):
            part = points[np.abs(azimuth_deg - heading_deg) < 30]
            assert not is_on_a_line(at_most(part, MEASURED)), (sensor, heading_deg)
    assert not is_on_a_line(np.zeros((MEASURED, 3), np.float32))


def test_a_field_that_looks_like_times_is_named():
    points = room()
    given = {axis: points[:, k] for k, axis in enumerate("xyz")}
    strange = scan_of_cloud(PointCloud({**given, "ts": np.linspace(0, 5e9, len(points))}))
    told = time_field_finding(strange)
    assert told.code == "time_field_unknown"
    assert told.text.startswith(
        "The field ts (float64, 0 to 5000000000) was not understood as times of the points: "
    )
    assert told.numbers == {"first": 0, "last": 5e9}
    sent = Localization(
        Verdict.REJECTED, findings=(scan_kinds.UNSURE.found({"inlier_ratio": 0.9, "probability": 0.5}),)
    )
    sent = replace(
        sent, findings=(*sent.findings, scan_kinds.NO_TIMES.found())
    )  # by a service that has no fields
    assert [one.code for one in with_time_field(sent, strange).findings] == ["unsure", "time_field_unknown"]
    assert with_time_field(with_time_field(sent, strange), strange) == with_time_field(sent, strange)
    for times in (np.linspace(0, 0.1, len(points)), np.zeros(len(points))):  # understood, and filled in
        assert time_field_finding(scan_of_cloud(PointCloud({**given, "ts": times}))) is None
    assert time_field_finding(scan_of_cloud(PointCloud(given))) is None


def test_a_bent_scan_without_times_may_be_one_in_motion():
    still, timed = (
        facts(Scan.from_points(room())),
        facts(Scan.from_points(room(), time_s=np.full(len(room()), 0.1))),
    )
    unsure = Localization(Verdict.REJECTED, (Reason.LOW_PROBABILITY,))
    assert "ask while it stands, or send the times" in no_times_finding(unsure, still).remedy
    assert no_times_finding(unsure, timed) is None
    assert no_times_finding(Localization(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,)), still) is None


def test_numbers_that_are_no_coordinates_are_of_no_unit():
    assert found(room() * 1e9).code == "no_coordinates"
    assert found(room() * 1e6).code == "unit_millimetres"

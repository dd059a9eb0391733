"""The metrics of the benchmark protocol, against figures worked out by hand."""

import math

import pytest

from firstfix_lab.score.metrics import (
    brier_score,
    calibration_error,
    reliability,
    report_of,
    risk_coverage,
    success_rate,
)
from firstfix_lab.score.scored import Scored


def posed(
    error_m: float, confidence: float | None = None, *, accepted: bool = True, deg: float = 0.0
) -> Scored:
    return Scored(True, error_m, deg, True, accepted, confidence, 0.5)


OUTSIDE = Scored(False, has_pose=True, is_accepted=True, confidence=0.2)
NOTHING = Scored(True, time_s=2.0)


def test_success_counts_accepted_poses_of_scans_of_the_map():
    cases = [posed(0.1), posed(0.1, deg=3.0), posed(1.5), posed(0.1, accepted=False), NOTHING, OUTSIDE]
    assert success_rate(cases, 0.2, 1.0) == pytest.approx(1 / 5)
    assert success_rate(cases, 1.0, 5.0) == pytest.approx(2 / 5)
    assert success_rate(cases, 2.0, 5.0) == pytest.approx(3 / 5)
    assert success_rate([OUTSIDE], 0.2, 1.0) is None


def test_the_risk_grows_where_a_wrong_pose_comes_in():
    curve = risk_coverage([posed(0.1, 0.9), posed(9.0, 0.7), posed(0.1, 0.8), NOTHING])
    assert curve is not None
    assert curve.coverage == pytest.approx([0.25, 0.5, 0.75])
    assert curve.risk == pytest.approx([0.0, 0.0, 1 / 3])
    assert curve.area == pytest.approx(1 / 9)
    assert (curve.coverage_at(0.0), curve.coverage_at(0.4)) == (0.5, 0.75)


def test_equal_confidences_are_one_level():
    """Else the order of the rows would decide."""
    for cases in ([posed(0.1, 0.9), posed(9.0, 0.9)], [posed(9.0, 0.9), posed(0.1, 0.9)]):
        curve = risk_coverage(cases)
        assert curve is not None
        assert (curve.coverage.tolist(), curve.risk.tolist()) == ([1.0], [0.5])
        assert curve.coverage_at(0.0) == 0.0


def test_calibration():
    cases = [posed(0.1, 1.0), posed(0.1, 0.92), posed(9.0, 0.3), posed(0.1)]
    high = reliability(cases)[1]
    assert (high.count, high.right) == (2, 1.0)
    assert high.confidence == pytest.approx(0.96)
    assert calibration_error(reliability(cases)) == pytest.approx((2 * 0.04 + 0.3) / 3)
    assert brier_score(cases) == pytest.approx((0.08**2 + 0.3**2) / 3)


def test_a_report():
    report = report_of([posed(0.1, 0.9), posed(3.0, 0.6), NOTHING, OUTSIDE])
    assert (report["cases"], report["outside"], report["accepted"], report["no_pose"]) == (4, 1, 3, 1)
    assert report["false_accepts"] == 2  # one is far off, one was not taken in the map
    assert report["success_0.2m_1deg"] == pytest.approx(1 / 3, abs=1e-4)
    assert (report["coverage_at_risk_0"], report["coverage_at_risk_0.01"]) == (0.25, 0.25)
    assert report["time_s_p50"] == 0.5


def test_a_system_without_confidences_or_times_gets_no_figures_of_them():
    report = report_of([Scored(True, 0.1, 0.1, True, True)])
    for name in ("area_under_risk_coverage", "ece", "brier", "time_s_p50", "coverage_at_risk_0"):
        assert report[name] is None
    assert report["success_0.2m_1deg"] == 1.0
    assert not math.isnan(report["false_accepts"])

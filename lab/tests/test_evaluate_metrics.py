"""Metrics of an evaluation, for answers with known errors."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.scan.scan import Scan
from firstfix.transform import inverse, make_transform, rotation_z, transform_points
from firstfix_lab.evaluation.outcome import angle_shares, outcome_of, random_yaws, report_of, turned

TRUTH = make_transform(rotation_z(0.3), [10.0, -4.0, 1.0])
REJECTED = Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))
AMBIGUOUS = Localization(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,))


def localized(off_m: float = 0.0, yaw_deg: float = 0.0, roll_deg: float = 0.0) -> Localization:
    c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    roll = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    error = make_transform(rotation_z(np.radians(yaw_deg)) @ roll, [0, off_m, 0])
    return Localization(Verdict.LOCALIZED, T_map_sensor=TRUTH @ error)


def report(*answers: Localization, elsewhere: tuple[Localization, ...] = (), ms: float = 10.0) -> dict:
    outcomes = [outcome_of("a", TRUTH, answer, ms) for answer in answers]
    outcomes += [outcome_of("b", None, answer, ms) for answer in elsewhere]
    return report_of(outcomes)


def test_the_keys_are_the_documented_ones():
    assert set(report(localized())) == {
        "n",
        "success_0.05m",
        "success_0.2m",
        "success_0.5m",
        "success_1m",
        "first_0.2m",
        "among_0.2m",
        "median_error_m",
        "median_error_deg",
        "false_accept_rate",
        "wrong_0.2m_rate",
        "verdicts",
        "ms",
    }
    assert set(report(localized())["verdicts"]) == {"localized", "ambiguous", "rejected"}
    assert set(report(localized())["ms"]) == {"p50", "p95", "p99"}


def test_success_is_over_every_scan_that_has_a_pose():
    found = report(localized(0.01), localized(0.1), localized(0.4), localized(0.9), REJECTED)
    assert found["n"] == 5
    assert [found[f"success_{limit}m"] for limit in ("0.05", "0.2", "0.5", "1")] == [0.2, 0.4, 0.6, 0.8]


def test_scans_from_elsewhere_do_not_count_as_missed():
    found = report(localized(), elsewhere=(REJECTED, REJECTED))
    assert found["n"] == 3
    assert found["success_0.05m"] == 1.0
    assert found["verdicts"] == {"localized": 1, "ambiguous": 0, "rejected": 2}


def test_success_needs_the_heading_too():
    found = report(localized(0.01, yaw_deg=4.9), localized(0.01, yaw_deg=-5.1))
    assert found["success_1m"] == 0.5


def test_yaw_is_about_the_vertical_of_the_map():
    outcome = outcome_of("a", TRUTH, localized(yaw_deg=3, roll_deg=8), 1.0)
    assert outcome.yaw_error_deg == pytest.approx(3, abs=0.02)
    assert outcome.error_deg == pytest.approx(np.hypot(3, 8), abs=0.05)


@pytest.mark.parametrize(
    ("answer", "false"),
    [
        (localized(0.99), False),
        (localized(1.01), True),
        (localized(0.0, yaw_deg=9.9), False),
        (localized(0.0, yaw_deg=10.1), True),
        (localized(0.0, roll_deg=10.1), True),
    ],
)
def test_what_a_false_accept_is(answer, false):
    assert report(answer)["false_accept_rate"] == float(false)


def test_false_accepts_are_counted_among_the_localized():
    found = report(localized(), localized(5.0), REJECTED, AMBIGUOUS, elsewhere=(localized(), REJECTED))
    assert found["false_accept_rate"] == pytest.approx(2 / 3)
    assert found["verdicts"] == {"localized": 3, "ambiguous": 1, "rejected": 2}


@pytest.mark.parametrize(
    ("answer", "wrong"),
    [(localized(0.19), False), (localized(0.21), True), (localized(5.0), True), (localized(0.0, 11), True)],
)
def test_what_is_wrong_by_over_a_fifth_of_a_metre(answer, wrong):
    assert report(answer, REJECTED)["wrong_0.2m_rate"] == float(wrong)


def test_medians_are_over_localized_scans_with_a_pose():
    found = report(
        localized(0.1), localized(0.3, yaw_deg=2), localized(0.2), REJECTED, elsewhere=(localized(),)
    )
    assert found["median_error_m"] == pytest.approx(0.2)
    assert found["median_error_deg"] == pytest.approx(0.0, abs=1e-6)


def test_nothing_localized_is_no_error_of_zero():
    found = report(REJECTED, AMBIGUOUS)
    assert found["median_error_m"] is None
    assert found["median_error_deg"] is None
    assert found["false_accept_rate"] == 0.0
    assert found["success_1m"] == 0.0


def test_percentiles_of_the_time():
    outcomes = [outcome_of("a", TRUTH, localized(), float(ms)) for ms in range(1, 102)]
    assert report_of(outcomes)["ms"] == {"p50": 51.0, "p95": 96.0, "p99": 100.0}


def test_shares_by_angle():
    outcomes = [outcome_of("a", TRUTH, localized(yaw_deg=d), 1.0) for d in (0.5, 1.5, 3, 7)]
    assert angle_shares(outcomes) == {"1deg": 0.25, "2deg": 0.5, "5deg": 0.75}


def test_a_turned_scan_shows_the_same_world_from_its_own_pose():
    scan = Scan.from_points(np.random.default_rng(0).uniform(-30, 30, (200, 3)), np.arange(200), 3.0)
    other, pose = turned(scan, TRUTH, 1.234)
    np.testing.assert_allclose(
        transform_points(pose, other.points), transform_points(TRUTH, scan.points), atol=1e-4
    )
    step = inverse(TRUTH) @ pose
    np.testing.assert_allclose(step[:3, 3], 0, atol=1e-12)
    np.testing.assert_allclose(step[:3, :3], rotation_z(-1.234), atol=1e-12)
    assert other.stamp_s == 3.0
    assert turned(scan, None, 1.0)[1] is None


def test_random_yaws_are_the_seeds():
    np.testing.assert_array_equal(random_yaws(9, 5), random_yaws(9, 5))
    assert not np.array_equal(random_yaws(9, 5), random_yaws(9, 6))
    assert np.ptp(random_yaws(500, 5)) > 6
    assert not random_yaws(9, None).any()


def with_hypotheses(*off_m: float, yaw_deg: float = 0.0) -> Localization:
    turn = make_transform(rotation_z(np.radians(yaw_deg)), np.zeros(3))
    poses = [TRUTH @ make_transform(np.eye(3), [0, off, 0]) @ turn for off in off_m]
    hypotheses = tuple(Hypothesis(pose, None, 0.1, 0) for pose in poses)
    return Localization(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,), hypotheses=hypotheses)


def test_what_was_not_found_is_told_from_what_was_ranked_wrongly():
    first, second, nowhere = with_hypotheses(0.1, 7.0), with_hypotheses(7.0, 0.15), with_hypotheses(7.0, 0.3)
    found = report(first, second, nowhere, REJECTED, elsewhere=(first,))
    assert found["first_0.2m"] == 0.25
    assert found["among_0.2m"] == 0.5
    assert found["success_0.2m"] == 0.0
    outcome = outcome_of("a", TRUTH, second, 1.0)
    assert outcome.first_error_m == pytest.approx(7.0)
    assert outcome.among_error_m == pytest.approx(0.15)


def test_a_hypothesis_that_is_turned_away_is_not_the_true_place():
    assert report(with_hypotheses(0.1, yaw_deg=20))["among_0.2m"] == 0.0

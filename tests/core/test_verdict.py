import numpy as np
import pytest

from firstfix.calibration import Calibration
from firstfix.localization import Reason, Verdict
from firstfix.places import Place
from firstfix.registration import Registration
from firstfix.transform import make_transform
from firstfix.verdict import judge

CALIBRATION = Calibration(bias=-20, overlap=20, margin=20, min_probability=0.9, min_overlap=0.5)


def places(*overlaps: float) -> list[Place]:
    return [
        Place(i, Registration(make_transform(np.eye(3), [10.0 * i, 0, 0]), overlap, overlap / 2, np.eye(6)))
        for i, overlap in enumerate(overlaps)
    ]


def verdict_of(*overlaps: float, min_probability: float | None = None):
    return judge(places(*overlaps), np.eye(4), CALIBRATION, min_probability)


def test_a_good_place_without_rivals_is_localized():
    judged = verdict_of(0.9, 0.4)
    assert judged.verdict is Verdict.LOCALIZED
    assert judged.reasons == ()
    assert judged.probability == pytest.approx(1 / (1 + np.exp(-(-20 + 18 + 10))))


def test_a_twin_makes_it_ambiguous_and_both_are_returned():
    judged = verdict_of(0.9, 0.88)
    assert (judged.verdict, judged.reasons) == (Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,))
    assert [h.template for h in judged.hypotheses] == [0, 1]
    assert judged.hypotheses[0].probability >= judged.hypotheses[1].probability


def test_a_twin_makes_it_ambiguous_however_sure_the_model_is():
    sure = Calibration(bias=0, overlap=50, margin=0, min_margin=0.15)
    assert judge(places(0.99, 0.95), np.eye(4), sure, None).verdict is Verdict.AMBIGUOUS
    assert judge(places(0.99, 0.80), np.eye(4), sure, None).verdict is Verdict.LOCALIZED


def test_little_overlap_is_rejected_whatever_the_caller_asks():
    judged = verdict_of(0.45, min_probability=0.0)
    assert (judged.verdict, judged.reasons) == (Verdict.REJECTED, (Reason.LOW_OVERLAP,))


def test_a_doubtful_place_is_rejected_unless_the_caller_takes_it():
    calibration = Calibration(bias=-20, overlap=20, margin=0, min_probability=0.9, min_overlap=0.5)
    doubtful = places(0.95)
    assert judge(doubtful, np.eye(4), calibration, None).reasons == (Reason.LOW_PROBABILITY,)
    assert judge(doubtful, np.eye(4), calibration, 0.2).verdict is Verdict.LOCALIZED


def test_no_place_is_no_candidate():
    assert verdict_of().reasons == (Reason.NO_CANDIDATE,)


def test_poses_are_in_the_map_frame():
    T_map_level = make_transform(np.eye(3), [500000.0, 5400000.0, 0])
    judged = judge(places(0.9), T_map_level, CALIBRATION, None)
    assert judged.hypotheses[0].T_map_sensor[:3, 3].tolist() == [500000.0, 5400000.0, 0]

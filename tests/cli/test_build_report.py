"""The self-test of a version as text."""

from firstfix_cli.build_report import self_test_lines

TESTED = {
    "queries": 120,
    "outside": 30,
    "success": {"0.2m": 0.9},
    "found": 0.95,
    "localized": 0.8,
    "median_error_m": 0.02,
    "false_accepts": 0,
}


def threshold(share: float, least: float, localized: float, bound: float, kept_by: str) -> dict[str, object]:
    return {
        "max_false_accept": share,
        "min_probability": least,
        "localized": localized,
        "bound": bound,
        "kept_by": kept_by,
    }


def test_the_promise_and_the_cost_of_others_are_told():
    loose = threshold(0.01, 0.9, 0.85, 0.004, "rate")
    strict = threshold(0.001, 0.999, 0.5, 0.004, "each answer")
    usual = threshold(0.005, 0.95, 0.8, 0.0041, "rate")
    lines = self_test_lines({**TESTED, "threshold": {**usual, "others": [loose, usual, strict]}})
    assert lines[2:] == [
        "  localized from probability 0.95: at most 1 in 200 wrong (the self-test shows at most 0.41%)",
        "  localized, by how many may be wrong: 85% at 1 in 100, 80% at 1 in 200, 50% at 1 in 1,000",
    ]
    lines = self_test_lines({**TESTED, "threshold": {**strict, "others": [loose, usual, strict]}})
    assert lines[2] == (
        "  localized from probability 0.999: at most 1 in 1,000 wrong "
        "(each answer by itself; the self-test shows at most 0.40%)"
    )
    taught = threshold(0.005, 0.99, 0.8, 0.0041, "many maps")
    lines = self_test_lines({**TESTED, "threshold": {**taught, "others": [loose, usual, strict]}})
    assert lines[2] == (
        "  localized from probability 0.99: at most 1 in 200 wrong (many maps show at most 0.41%)"
    )


def test_both_parts_of_the_self_test_are_told():
    parts = {"as real": {"queries": 80, "localized": 0.95}, "roughly": {"queries": 40, "localized": 0.6}}
    lines = self_test_lines({**TESTED, "parts": parts})
    assert lines[2] == "  localized: 95% of 80 disturbed as real, 60% of 40 disturbed roughly"
    only = {**parts, "roughly": {"queries": 0, "localized": 0.0}}
    assert self_test_lines({**TESTED, "parts": only}) == self_test_lines(TESTED)


def test_real_and_simulated_success_stand_side_by_side():
    real = {
        "asked": 9,
        "weight": 3.0,
        "success": {"0.2m": 0.5},
        "localized": 0.4,
        "median_error_m": 0.3,
        "false_accepts": 1,
        "disagree": ["localized"],
        "left_out": {"x.pcd": "it has no pose"},
        "confirmed": {
            "asked": 4,
            "robots": 2,
            "told_by": 1,
            "told_from": "2026-03-02T09:00:00+00:00",
            "told_to": "2026-03-04T09:00:00+00:00",
        },
    }
    assert self_test_lines({**TESTED, "real": real})[2:] == [
        "  9 real scans, each as heavy as 3 simulated ones: 50% within 0.2m",
        "    median error 0.300 m, 40% answered localized, 1 false among them",
        "    4 of them queries of 2 robots, confirmed by 1 callers, 2026-03-02 to 2026-03-04",
        "    real and simulated scans disagree (localized): believe the real ones",
        "  real scans left out:",
        "    x.pcd: it has no pose",
    ]
    assert self_test_lines({**TESTED, "real": {}}) == self_test_lines(TESTED)


def test_keyframes_that_were_held_out_are_counted_and_those_that_stay_too():
    real = {
        "asked": 6,
        "weight": 1.0,
        "success": {"1m": 1.0},
        "localized": 1.0,
        "median_error_m": 0.02,
        "false_accepts": 0,
        "disagree": [],
        "left_out": {},
        "held_out": {"keyframes": 6, "parts": 3, "kept_out": {"no other keyframe saw what they see": 2}},
    }
    assert self_test_lines({**TESTED, "real": real})[4:] == [
        "    the map was made without 6 keyframes in 3 parts",
        "    2 keyframes could not be held out: no other keyframe saw what they see",
    ]
    none = {"asked": 0, "held_out": {"keyframes": 0, "parts": 0, "kept_out": {"too few": 12}}}
    assert self_test_lines({**TESTED, "real": none})[2:] == [
        "    12 keyframes could not be held out: too few"
    ]


def test_the_share_of_places_that_were_found_comes_first():
    assert self_test_lines({**TESTED, "found": 0.9})[1].startswith("  90% of the places found, ")


def test_what_was_not_measured_has_no_line():
    assert len(self_test_lines(TESTED)) == 2

from firstfix_cli.build_report import self_test_lines

TESTED = {
    "queries": 10,
    "success": {"0.2m": 1.0},
    "median_error_m": 0.01,
    "localized": 0.9,
    "false_accepts": 0,
    "outside": 3,
}


def test_floor_without_templates_is_told_and_no_line_says_that_there_is_none():
    told = "12% of the seen floor has no template: not reachable"
    some, none = {"seen_m2": 100.0, "without_template": 0.12}, {"seen_m2": 100.0, "without_template": 0.0}
    assert self_test_lines({**TESTED, "floor": some})[-1].strip() == told
    assert self_test_lines({"queries": 0, "floor": some}) == ["self-test: none", told]
    for floor in ({"floor": none}, {"floor": None}, {}):  # all has; no trajectory; an older version
        assert self_test_lines({**TESTED, **floor}) == self_test_lines(TESTED)

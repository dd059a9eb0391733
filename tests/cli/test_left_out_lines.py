from firstfix_cli.build_report import self_test_lines

TESTED = {
    "queries": 10,
    "success": {"0.2m": 1.0},
    "median_error_m": 0.01,
    "found": 0.95,
    "localized": 0.9,
    "false_accepts": 0,
    "outside": 3,
}


def test_places_that_are_known_and_not_said_are_counted_with_what_helps():
    cells = [{"scans": 1, "helps": code} for code in ("prior", "second_scan", "second_scan")]
    lines = self_test_lines({"queries": 0, "localizability": [*cells, {"scans": 2}]})
    assert lines[1].startswith("3 of 4 places are known and not said")
    assert lines[2:] == [
        "  a prior, as what looks alike is above, below or beside it: 1",
        "  a second scan from 1 to 2 m further on, or a prior: 2",
    ]


def test_points_of_moving_things_and_scans_that_were_not_used_are_told():
    moving = {"scans": 4, "left_out": 0.008, "passed": 0.008, "not_used": {}}
    said = "0.8% of the points left out: later rays passed through them"
    assert self_test_lines({**TESTED, "moving": moving})[-1] == said
    refused = {**moving, "left_out": 0.0, "passed": 0.3, "not_used": {"7.pcd": "it has no valid pose"}}
    assert self_test_lines({**TESTED, "moving": refused})[-2:] == [
        "rays passed through 30.0% of the points, so none was left out",
        "1 mapping scans not used, such as 7.pcd: it has no valid pose",
    ]
    nothing = {**moving, "left_out": 0.0, "passed": 0.0}
    for none in (nothing, None):
        assert self_test_lines({**TESTED, "moving": none}) == self_test_lines(TESTED)


def test_floor_without_templates_is_told_and_no_line_says_that_there_is_none():
    told = "12% of the seen floor has no template: not reachable"
    some, none = {"seen_m2": 100.0, "without_template": 0.12}, {"seen_m2": 100.0, "without_template": 0.0}
    assert self_test_lines({**TESTED, "floor": some})[-1].strip() == told
    assert self_test_lines({"queries": 0, "floor": some}) == ["self-test: none", told]
    for floor in ({"floor": none}, {"floor": None}, {}):  # all has; no trajectory; an older version
        assert self_test_lines({**TESTED, **floor}) == self_test_lines(TESTED)


def test_places_mapped_in_part_are_told_with_what_scans_did_there():
    mapped = {"places": 140, "in_part": 12, "localized_in_part": 0.4, "localized_elsewhere": 0.85}
    told = "12 of 140 places were mapped in part, from a door or from afar"
    lines = self_test_lines({**TESTED, "mapped": mapped})
    assert lines[-1] == f"{told}: 40% of scans localized there, 85% elsewhere"
    untested = {**mapped, "localized_in_part": None}
    assert self_test_lines({**TESTED, "mapped": untested})[-1] == told
    for none in ({**mapped, "in_part": 0}, None):
        assert self_test_lines({**TESTED, "mapped": none}) == self_test_lines(TESTED)

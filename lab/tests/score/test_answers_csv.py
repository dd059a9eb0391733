"""CSV files of any system: what is read, and which row and column an error names."""

import json
from pathlib import Path

import pytest

from firstfix.errors import FirstfixError, NotFound
from firstfix_cli.main import run
from firstfix_lab.score.answers_csv import score
from tests.every_case import every_case

HEAD = "scan,tx,ty,tz,qx,qy,qz,qw"
CASES = f"{HEAD}\na.pcd,1,2,0,0,0,0,1\nb.pcd,5,2,0,0,0,0,1\nelsewhere.pcd,,,,,,,\n"
GOOD = f"{HEAD},confidence,accepted,time_s\n"


@pytest.fixture
def cases(tmp_path: Path) -> Path:
    path = tmp_path / "cases.csv"
    path.write_text(CASES)
    return path


def answers(cases: Path, text: str) -> Path:
    path = cases.with_name("answers.csv")
    path.write_text(text)
    return path


def test_answers_are_scored_in_the_order_of_the_cases(cases):
    rows = "elsewhere.pcd,0,0,0,0,0,0,1,0.4,0,0.2\na.pcd,1.1,2,0,0,0,0,1,0.9,1,0.1\n"
    a, b, elsewhere = score(cases, answers(cases, GOOD + rows))
    assert (a.is_accepted, a.confidence, a.time_s) == (True, 0.9, 0.1)
    assert a.error_m == pytest.approx(0.1)
    assert (b.is_inside, b.has_pose, b.is_accepted) == (True, False, False)
    assert (elsewhere.is_inside, elsewhere.has_pose, elsewhere.is_accepted) == (False, True, False)
    assert not elsewhere.is_right


def test_a_pose_counts_as_accepted_where_the_system_does_not_say(cases):
    a, b, _ = score(cases, answers(cases, f"{HEAD}\na.pcd,1,2,0,0,0,0,1\nb.pcd,,,,,,,\n"))
    assert a.is_accepted
    assert a.confidence is None
    assert not b.is_accepted


@every_case(
    "row, said",
    [
        ("c.pcd,0,0,0,0,0,0,1,,,", "row 2, column scan: 'c.pcd' is no case"),
        ("a.pcd,0,0,0,0,0,0,1,,,\na.pcd,0,0,0,0,0,0,1,,,", "row 3, column scan: 'a.pcd' is named twice"),
        (",0,0,0,0,0,0,1,,,", "row 2, column scan: the scan has no name"),
        ("a.pcd,0,x,0,0,0,0,1,,,", "row 2, column ty: must be a number, not 'x'"),
        ("a.pcd,0,nan,0,0,0,0,1,,,", "row 2, column ty: must be finite"),
        ("a.pcd,0,,0,0,0,0,1,,,", "row 2, column ty: is empty"),
        ("a.pcd,0,0,0,0,0,0,2,,,", "row 2, column qx,qy,qz,qw: must be a quaternion"),
        ("a.pcd,0,0,0,0,0,0,0,,,", "row 2, column qx,qy,qz,qw: must be a quaternion"),
        ("a.pcd,0,0,0,0,0,0,1,90,,", "row 2, column confidence: must lie in 0..1, not 90"),
        ("a.pcd,0,0,0,0,0,0,1,,maybe,", "row 2, column accepted: must be 1 or 0, not 'maybe'"),
        ("a.pcd,,,,,,,,,1,", "row 2, column accepted: an answer without a pose"),
        ("a.pcd,0,0,0,0,0,0,1,,,-1", "row 2, column time_s: must lie in"),
        ("a.pcd,0,0,0,0,0,0,1", "row 2: 8 cells under 11 column names"),
    ],
)
def test_a_bad_row_is_named(row, said, cases):
    with pytest.raises(FirstfixError) as caught:
        score(cases, answers(cases, f"{GOOD}{row}\n"))
    assert said in str(caught.value)


def test_a_missing_column_or_file_is_named(cases, tmp_path):
    with pytest.raises(FirstfixError, match="no column ty"):
        score(cases, answers(cases, "scan,tx,tz,qx,qy,qz,qw\n"))
    with pytest.raises(NotFound):
        score(cases, tmp_path / "nothing.csv")
    cases.write_text(HEAD + "\n")
    with pytest.raises(FirstfixError, match="no cases"):
        score(cases, answers(cases, HEAD + "\n"))


def ended(arguments: list[object]) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


def test_the_command_prints_all_metrics(cases, capsys):
    path = answers(cases, f"{GOOD}a.pcd,1.1,2,0,0,0,0,1,0.9,1,0.1\nb.pcd,9,2,0,0,0,0,1,0.3,1,0.3\n")
    assert ended(["evaluate", cases, "--answers", path, "--json", "-"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert (report["success_0.2m_1deg"], report["false_accepts"], report["time_s_p50"]) == (0.5, 1, 0.2)
    assert ended(["evaluate", cases, "--answers", path]) == 0
    said = capsys.readouterr().out
    assert "3 cases, 1 outside the map: 2 accepted, 1 without a pose" in said
    assert "50.0% within 0.2 m, 1 deg" in said


def test_the_command_does_not_ask_and_score_at_once(cases, capsys):
    path = answers(cases, GOOD)
    assert ended(["evaluate", cases, "--answers", path, "--map", "hall"]) == 2
    assert "--answers can only be used with" in capsys.readouterr().err
    assert ended(["evaluate", cases]) == 2
    assert "give --map" in capsys.readouterr().err

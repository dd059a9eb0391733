"""Poses without Python and without a service: the answers of a service."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.decode import decode_query
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import InvalidOption
from firstfix.ros.media_types import POINT_CLOUD2
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.wire.scan import decode_scan
from tests.cpp.cpp_build import Build
from tests.cpp.printed_answers import (
    PROGRAM,
    UNEXPLAINED,
    findings_of,
    in_time,
    lines_of,
    noise,
    of_one_side,
    printed,
    same,
    upside_down,
    written,
)
from tests.needs import recorded
from tests.ros_samples import cdr, cloud

FORMS = {
    "as it is": lambda scan: scan,
    "upside down": upside_down,
    "of one side": lambda scan: of_one_side(scan, 60),
    "in time": in_time,
    "noise": noise,
    "too few": lambda scan: Scan(scan.points[:20]),
}


@pytest.mark.parametrize("form", FORMS)
def test_it_answers_as_a_service_does(on_board: Build, folder: Path, small_scans, tmp_path: Path, form: str):
    localizer = Localizer(MapIndex.load(folder), explains=False)
    for number, (scan, _) in enumerate(small_scans[:3]):
        path = written(FORMS[form](scan), tmp_path / f"{number}.ffscan")
        answer = localizer.localize(decode_scan(path.read_bytes()))
        done = on_board.run(PROGRAM, folder, path, UNEXPLAINED)
        assert same(printed(done), answer)
        assert done.stderr == findings_of(answer)
        assert answer.verdict.value != "localized" or form not in ("noise", "too few")


def test_options_are_those_of_a_service(on_board: Build, folder: Path, small_scans, tmp_path: Path):
    localizer = Localizer(MapIndex.load(folder), explains=False)
    scan, T_map_sensor = small_scans[1]
    path = written(in_time(scan), tmp_path / "scan.ffscan")
    sent, down = decode_scan(path.read_bytes()), -T_map_sensor[2, :3]
    at = ",".join(repr(float(v)) for v in T_map_sensor[:3, 3])
    verdicts = set()
    for asked in (
        {"prior": f"{at},1.0"},
        {"prior": f"{at},3.0,0,20"},
        {"prior": "5,5,1,0.5"},
        {"prior": "500,500,1,0.5"},
        {"gravity": ",".join(repr(float(v)) for v in down * 9.81)},
        {"gravity": "0.3,-0.4,-9.7"},
        {"min_probability": "1.0"},
        {"min_probability": "0.0", "max_candidates": "3"},
        {"twist": "0.3,0,0,0,0,0.2"},
        {"T_base_sensor": "0.1,0,0.5,0,0,0.1,0.99"},
    ):
        answer = localizer.localize(sent, LocalizeOptions.from_strings(asked))
        done = on_board.run(
            PROGRAM, folder, path, UNEXPLAINED, *(f"{name}={value}" for name, value in asked.items())
        )
        assert same(printed(done), answer), asked
        assert done.stderr == findings_of(answer)
        verdicts.add(answer.verdict.value)
    assert verdicts >= {"localized", "rejected"}


WRONG_OPTIONS = (
    {"min_probability": "1.5"},
    {"min_probability": "nan"},
    {"min_probability": "0.9", "max_false_accept": "0.1"},
    {"max_false_accept": "-1e-05"},
    {"max_false_accept": "0.0"},  # no threshold of this map promises it
    {"max_candidates": "0"},
    {"max_candidates": "101"},
    {"deadline_ms": "0.0001"},
    {"deadline_ms": "123456789.25"},
    {"deadline_ms": "600000.0000000001"},
    {"prior": "0.0,0.0,0.0,-1.0"},
    {"prior": "0.0,0.0,0.0,1000000.5"},
    {"prior": "0.0,0.0,nan,1.0"},
    {"prior": "0.0,-inf,0.0,1.0"},
    {"prior": "0.0,0.0,0.0,1.0,0.0,0.0"},
    {"prior": "0.0,0.0,0.0,1.0,0.0,-2.5e-07"},
    {"prior": "0.0,0.0,0.0,1.0,2000000000.0,5.0"},
    {"gravity": "0.0,0.0,0.0"},
    {"gravity": "0.0,9e-07,0.0"},
    {"gravity": "0.1,1e+16,-123456789012345.6"},
    {"gravity": "1e+300,5e-324,-1.2345678901234567e-100"},
    {"twist": "100.5,0.0,0.0,0.0,0.0,0.0"},
    {"twist": "0.0,0.0,0.0,0.0,-20.25,0.0"},
    {"T_base_sensor": "0.0,0.0,0.0,0.0,0.0,0.0,0.0"},
    {"T_base_sensor": "0.0,0.0,nan,0.0,0.0,0.0,1.0"},
    {"T_odom_base": "0.0,0.0,0.0,0.0,0.0,0.0,1e-10"},
)


def test_options_have_the_limits_and_messages_of_a_service(
    on_board: Build, folder: Path, scan_file: Path, small_scans
):
    localizer = Localizer(MapIndex.load(folder), explains=False)
    for wrong in WRONG_OPTIONS:
        with pytest.raises(InvalidOption) as refused:
            localizer.localize(small_scans[0][0], LocalizeOptions.from_strings(wrong))
        done = on_board.run(PROGRAM, folder, scan_file, *(f"{name}={value}" for name, value in wrong.items()))
        assert (done.returncode, done.stderr) == (1, f"{PROGRAM}: invalid_option: {refused.value}\n"), wrong


def test_a_twist_of_a_scan_without_times_is_refused(on_board: Build, folder: Path, scan_file: Path):
    done = on_board.run(PROGRAM, folder, scan_file, "twist=0,0,0,0,0,0")
    assert "invalid_option: a twist needs the times of the scan's points" in done.stderr


def test_a_twist_of_a_scan_without_returns_is_answered_as_by_a_service(
    on_board: Build, folder: Path, tmp_path: Path
):
    """Its points have times, though none of them is left."""
    made = np.zeros(100, [("x", "f4"), ("y", "f4"), ("z", "f4"), ("t", "u4")])
    made["x"], made["t"] = np.nan, np.linspace(0, 1e8, len(made))
    path, twist = tmp_path / "scan.cdr", "0.3,0,0,0,0,0.2"
    path.write_bytes(cdr(cloud(made)))
    scan = decode_query(path.read_bytes(), POINT_CLOUD2)
    answer = Localizer(MapIndex.load(folder)).localize(scan, LocalizeOptions.from_strings({"twist": twist}))
    done = on_board.run(PROGRAM, folder, path, f"twist={twist}")
    assert same(printed(done), answer)
    assert done.stderr == findings_of(answer)


def test_words_that_are_no_option_are_refused(on_board: Build, folder: Path, scan_file: Path):
    for wrong in ("other=1", "gravity", "gravity=down", "gravity=1,2", "max_candidates=2.5"):
        done = on_board.run(PROGRAM, folder, scan_file, wrong)
        assert (done.returncode, "invalid_option: " in done.stderr) == (1, True), (wrong, done.stderr)


def test_a_deadline_ends_the_search_of_a_hard_scan(
    on_board: Build, folder: Path, small_scans, tmp_path: Path
):
    """After one that is over, the first step alone is taken."""
    localizer = Localizer(MapIndex.load(folder), explains=False)
    path = written(noise(small_scans[0][0]), tmp_path / "noise.ffscan")
    scan = decode_scan(path.read_bytes())
    in_haste = localizer.localize(scan, deadline=-math.inf)
    assert same(printed(on_board.run(PROGRAM, folder, path, UNEXPLAINED, "deadline_ms=1")), in_haste)
    assert lines_of(in_haste) != lines_of(localizer.localize(scan))


def test_a_cancelled_query_ends_and_the_next_one_is_answered_as_before(
    on_board: Build, folder: Path, scan_file: Path
):
    first, at_once, other, running, last = on_board.run(
        "firstfix_cancelled", folder, scan_file
    ).stdout.splitlines()
    assert first.split()[0] in ("localized", "ambiguous", "rejected")
    assert (at_once, running) == ("query_cancelled", "query_cancelled")
    assert first == other == last


@pytest.mark.slow
def test_it_answers_as_a_service_does_in_a_real_hall(on_board: Build, hall_directory: Path, tmp_path: Path):
    localizer = Localizer(MapIndex.load(hall_directory), explains=False)
    verdicts = []
    for path in sorted((recorded("hilti_hall_indoor") / "queries").glob("*.pcd")):
        scan = read_scan_file(path)
        for form in ("as it is", "upside down", "of one side"):
            again = written(FORMS[form](scan), tmp_path / "scan.ffscan")
            answer = localizer.localize(decode_scan(again.read_bytes()))
            assert same(printed(on_board.run(PROGRAM, hall_directory, again, UNEXPLAINED)), answer), (
                path.name,
                form,
            )
            verdicts.append(answer.verdict.value)
    assert verdicts.count("localized") >= len(verdicts) / 3

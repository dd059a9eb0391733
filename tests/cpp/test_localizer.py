"""Poses without Python and without a service: the answers of a service, and no damaged version is read."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.errors import InvalidOption
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import quaternion_of
from firstfix.wire.scan import decode_scan, encode_scan
from tests.cpp.cpp_build import Build
from tests.cpp.stored_versions import any_bytes, damaged, rewritten, stored
from tests.needs import recorded

PROGRAM = "firstfix_localize_here"
EXIT_CODES = {"localized": 0, "ambiguous": 3, "rejected": 4}
FILES = (
    "engine.json",
    "calibration.json",
    "surface_fine.safetensors",
    "surface_coarse.safetensors",
    "view_near.safetensors",
    "view_far.safetensors",
)
OPTIONAL_FILES = ("seen_free.safetensors", "aliases.safetensors", "false_accept_bound.json")


@pytest.fixture(scope="module")
def folder(small_version, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small world's version as it lies in a store, with space that a mapping run saw free."""
    rng = np.random.default_rng(5)
    brick = np.argwhere(rng.random((12, 10, 3)) < 0.3) - [6, 5, 1]
    bits = (rng.integers(-(2**31), 2**31, (len(brick), 8, 2)) & 0x01010101).astype(np.int32)
    built = tmp_path_factory.mktemp("built") / "version"
    shutil.copytree(small_version.directory, built)
    SeenFree.of_bricks(brick, bits, 0.2).save(built)
    return stored(built, tmp_path_factory.mktemp("versions"))


def lines_of(answer: Localization) -> list[tuple[str, list[str], list[float]]]:
    """An answer as the program writes it: names, words, numbers."""
    lines: list[tuple[str, list[str], list[float]]] = [
        ("verdict", [answer.verdict.value], []),
        ("probability", [], [answer.probability]),
    ]
    lines += [("reason", [reason.value], []) for reason in answer.reasons]
    if answer.T_map_sensor is not None and answer.covariance is not None:
        lines.append(("T_map_sensor", [], pose_of(answer.T_map_sensor)))
        lines.append(("covariance", [], answer.covariance.ravel().tolist()))
    if answer.T_map_base is not None:
        lines.insert(3 + len(answer.reasons), ("T_map_base", [], pose_of(answer.T_map_base)))
    if answer.twist is not None:
        lines.append(("twist", [], answer.twist.tolist()))
    for free in answer.degenerate:
        lines.append(("free", [free.motion.value], [*free.direction.tolist(), free.sigma]))
    for one in answer.hypotheses:
        fit = one.quality
        assert fit is not None
        shares = [fit.inlier_ratio, fit.alignment_score, fit.free_space_violation, fit.removed_surface]
        shares += [math.nan if fit.seen_free is None else fit.seen_free, float(one.template)]
        lines.append(("hypothesis", [], [one.probability, *shares, *pose_of(one.T_map_sensor)]))
    return lines


def pose_of(T: np.ndarray) -> list[float]:
    return [*T[:3, 3].tolist(), *quaternion_of(T).tolist()]


def printed(done: subprocess.CompletedProcess[str]) -> list[tuple[str, list[str], list[float]]]:
    """The lines of a program that ended with an answer."""
    assert done.returncode in EXIT_CODES.values(), done.stdout + done.stderr
    lines = []
    for line in done.stdout.splitlines():
        name, *rest = line.split()
        words = [word for word in rest if re.fullmatch("[a-z_]+", word) and word != "nan"]
        lines.append((name, words, [float(word) for word in rest[len(words) :]]))
    assert EXIT_CODES[lines[0][1][0]] == done.returncode
    return lines


def same(found: list[tuple[str, list[str], list[float]]], answer: Localization) -> bool:
    """Whether all names, words and numbers are equal; nan, which is not known, equals nan."""
    wanted = lines_of(answer)
    if [line[:2] for line in found] != [line[:2] for line in wanted]:
        return False
    return all(np.array_equal(a[2], b[2], equal_nan=True) for a, b in zip(found, wanted, strict=True))


def written(scan: Scan, path: Path) -> Path:
    path.write_bytes(encode_scan(scan))
    return path


def upside_down(scan: Scan) -> Scan:
    return Scan(scan.points * np.float32([1, -1, -1]))


def of_one_side(scan: Scan, width_deg: float) -> Scan:
    azimuth = np.degrees(np.arctan2(scan.points[:, 1], scan.points[:, 0]))
    return Scan(scan.points[np.abs(azimuth) < width_deg / 2])


def in_time(scan: Scan) -> Scan:
    azimuth = np.arctan2(scan.points[:, 1], scan.points[:, 0])
    return replace(scan, time_s=(azimuth / (2 * np.pi) * 0.1 - 0.05).astype(np.float32))


def noise(_: Scan) -> Scan:
    points = np.random.default_rng(1).uniform(-8, 8, (5000, 3))
    return Scan(points.astype(np.float32))


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
        assert same(printed(on_board.run(PROGRAM, folder, path)), answer)
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
        {"gravity": ",".join(repr(float(v)) for v in down * 9.81)},
        {"gravity": "0.3,-0.4,-9.7"},
        {"min_probability": "1.0"},
        {"min_probability": "0.0", "max_candidates": "3"},
        {"twist": "0.3,0,0,0,0,0.2"},
        {"T_base_sensor": "0.1,0,0.5,0,0,0.1,0.99"},
    ):
        answer = localizer.localize(sent, LocalizeOptions.from_strings(asked))
        done = on_board.run(PROGRAM, folder, path, *(f"{name}={value}" for name, value in asked.items()))
        assert same(printed(done), answer), asked
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
    assert same(printed(on_board.run(PROGRAM, folder, path, "deadline_ms=1")), in_haste)
    assert lines_of(in_haste) != lines_of(localizer.localize(scan))


@pytest.mark.slow
def test_it_answers_as_a_service_does_in_a_real_hall(on_board: Build, hall_directory: Path, tmp_path: Path):
    localizer = Localizer(MapIndex.load(hall_directory), explains=False)
    verdicts = []
    for path in sorted((recorded("hilti_hall_indoor") / "queries").glob("*.pcd")):
        scan = read_scan_file(path)
        for form in ("as it is", "upside down", "of one side"):
            again = written(FORMS[form](scan), tmp_path / "scan.ffscan")
            answer = localizer.localize(decode_scan(again.read_bytes()))
            assert same(printed(on_board.run(PROGRAM, hall_directory, again)), answer), (path.name, form)
            verdicts.append(answer.verdict.value)
    assert verdicts.count("localized") >= len(verdicts) / 3


def test_numbers_of_another_release_are_refused(
    on_board: Build, folder: Path, scan_file: Path, tmp_path: Path
):
    def without_one(numbers: dict[str, object]) -> None:
        del numbers["alignment_score" if "bias" in numbers else "likely"]

    def with_one_more(numbers: dict[str, object]) -> None:
        numbers["another"] = 1.0

    for number, change in enumerate((without_one, with_one_more)):
        for name in ("engine.json", "calibration.json"):
            numbers = json.loads((folder / name).read_bytes())
            change(numbers["ranking"] if name == "engine.json" else numbers)
            content = json.dumps(numbers).encode()
            other = damaged(
                folder,
                tmp_path / f"{name}-{number}",
                lambda at, name=name, content=content: rewritten(at, name, content),
            )
            assert "incompatible_version: " in on_board.run(PROGRAM, other, scan_file).stderr


def test_a_missing_file_is_refused(on_board: Build, folder: Path, scan_file: Path, tmp_path: Path):
    for name in (*FILES, *OPTIONAL_FILES):
        other = damaged(folder, tmp_path / name, lambda at, name=name: (at / name).unlink())
        done = on_board.run(PROGRAM, other, scan_file)
        assert done.returncode == 1
        assert re.search(rf"corrupt_version: .*{re.escape(name)}", done.stderr), done.stderr


def test_a_number_that_is_not_finite_is_refused(
    on_board: Build, folder: Path, scan_file: Path, tmp_path: Path
):
    for name, array in (("surface_fine.safetensors", "planes"), ("view_far.safetensors", "points")):
        content = bytearray((folder / name).read_bytes())
        header = int.from_bytes(content[:8], "little")
        at = 8 + header + json.loads(content[8 : 8 + header])[array]["data_offsets"][0]
        content[at : at + 4] = np.float32(np.nan).tobytes()
        wrong = bytes(content)
        other = damaged(
            folder, tmp_path / name, lambda at, name=name, wrong=wrong: rewritten(at, name, wrong)
        )
        done = on_board.run(PROGRAM, other, scan_file)
        assert f"corrupt_version: {name}: {array} has a number that is not finite" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", [*FILES, *OPTIONAL_FILES])
def test_files_of_any_bytes_end_in_an_error(
    sanitised_on_board: Build, folder: Path, scan_file: Path, tmp_path: Path, name: str
):
    """The manifest agrees with each, as an attacker's would."""
    content = (folder / name).read_bytes()
    for number, case in enumerate(any_bytes(content, len(name))):
        copy = damaged(folder, tmp_path / str(number), lambda at, case=case: rewritten(at, name, case))
        done = sanitised_on_board.run(PROGRAM, copy, scan_file, "max_candidates=2")
        assert done.returncode in (0, 1, 3, 4), done.stderr
        if done.returncode == 1:
            assert re.match(rf"{PROGRAM}: (corrupt|incompatible)_version: ", done.stderr), done.stderr
        shutil.rmtree(copy)

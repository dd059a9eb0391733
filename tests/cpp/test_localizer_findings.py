"""Why a scan is not localized, on board: a service's findings for every wrong input, and its facts."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.decode import decode_query
from firstfix.engine.diagnosis import diagnose
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.ros.media_types import POINT_CLOUD2
from firstfix.scan.scan import Scan
from firstfix.wire.scan import decode_scan
from tests.cpp.cpp_build import Build
from tests.cpp.printed_answers import EXIT_CODES, PROGRAM, findings_of, printed, same, upside_down, written
from tests.e2e.wrong_inputs import MAP_POINTS, WRONG_INPUTS, RightScan
from tests.ros_samples import cdr, cloud

_XYZ = [("x", "f4"), ("y", "f4"), ("z", "f4")]


@pytest.fixture(autouse=True)
def _time_for_all_forms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which forms are tried depends on how fast they are: both try all of them."""
    monkeypatch.setattr(diagnose, "MAX_TIME", math.inf)


@pytest.fixture(scope="module")
def right(small_world, small_scans) -> RightScan:
    return RightScan.of(small_world, small_scans)


def points_of(file: bytes) -> NDArray[np.float32] | None:
    """Points of a wrong input's PLY; None: it has none."""
    if not file.startswith(b"ply"):
        return None
    with np.errstate(over="ignore"):
        return np.frombuffer(file.partition(b"end_header\n")[2], "<f8").astype("<f4").reshape(-1, 3)


def answered(
    build: Build, folder: Path, file: Path, scan: Scan, options: Mapping[str, str] = {}
) -> Localization:
    """The answer of both, which is the same."""
    answer = Localizer(MapIndex.load(folder)).localize(scan, LocalizeOptions.from_strings(options))
    asked = [f"{name}={value}" for name, value in options.items()]
    done = build.run(PROGRAM, folder, file, *asked, "explaining=inf")
    assert done.stderr == findings_of(answer)
    assert same(printed(done), answer), done.stdout
    return answer


def test_every_wrong_input_is_named_as_by_a_service(
    on_board: Build, version_folder: Path, right: RightScan, tmp_path: Path
):
    codes, path = set(), tmp_path / "scan.f32"
    for wrong in WRONG_INPUTS:
        points = points_of(wrong.content(right))
        if points is None or len(points) > MAP_POINTS:
            continue
        path.write_bytes(points.tobytes())
        answer = answered(on_board, version_folder, path, Scan.from_points(points), wrong.options(right))
        codes |= {one.code for one in answer.findings}
    assert codes >= {
        *("unit_millimetres", "unit_centimetres", "scaled", "scan_empty", "few_points", "nothing_valid"),
        *("all_too_near", "one_plane", "map_coordinates", "other_viewpoint", "no_viewpoint", "mirrored"),
        *("polar", "transposed", "gravity_sign", "gravity_wrong", "prior_wrong", "mounting", "no_place_fits"),
    }


def test_an_intensity_in_the_wrong_place_is_found(
    on_board: Build, version_folder: Path, right: RightScan, tmp_path: Path
):
    x, y, z = right.points.T
    rings = np.arange(len(x)) % 97
    for first, code in ((rings, "columns_shifted"), (rings / 100, "columns_shifted"), (x, None)):
        wrong = Scan.from_points(np.column_stack([first, x, y] if code else [x, y, z]), z)
        path = written(wrong, tmp_path / "scan.ffscan")
        answer = answered(on_board, version_folder, path, decode_scan(path.read_bytes()))
        assert (code is None) == (answer.verdict.value == "localized")
        assert code in {one.code for one in answer.findings} or code is None


def test_times_that_were_not_understood_are_named(
    on_board: Build, version_folder: Path, right: RightScan, tmp_path: Path
):
    path, codes = tmp_path / "scan.cdr", []
    for points in (right.points, right.points[:, [0, 2, 1]] * [1.0, 0.7, 1.0]):
        made = np.zeros(len(points), [*_XYZ, ("t", "u4")])
        for number, axis in enumerate("xyz"):
            made[axis] = points[:, number]
        for times in (
            np.zeros(len(points)),
            np.linspace(0, 4e9, len(points)),
            np.linspace(0, 1e8, len(points)),
        ):
            made["t"] = times
            path.write_bytes(cdr(cloud(made)))
            answer = answered(on_board, version_folder, path, decode_query(path.read_bytes(), POINT_CLOUD2))
            codes.append({one.code for one in answer.findings})
    assert [bool(found & {"time_field_unknown"}) for found in codes] == [False, True, False] * 2


def test_without_time_the_cause_is_not_sought(
    on_board: Build, version_folder: Path, right: RightScan, tmp_path: Path
):
    path = tmp_path / "scan.f32"
    path.write_bytes((right.points * [1, -1, 1]).astype("<f4").tobytes())
    assert "mirrored: " in on_board.run(PROGRAM, version_folder, path, "explaining=inf").stderr
    assert "mirrored: " not in on_board.run(PROGRAM, version_folder, path, "explaining=0").stderr
    assert (
        "mirrored: "
        not in on_board.run(PROGRAM, version_folder, path, "explaining=inf", "deadline_ms=1").stderr
    )


def test_a_robot_on_its_back_is_told(on_board: Build, version_folder: Path, small_scans, tmp_path: Path):
    scan = upside_down(small_scans[0][0])
    path = written(scan, tmp_path / "scan.ffscan")
    answer = answered(on_board, version_folder, path, decode_scan(path.read_bytes()))
    assert [one.code for one in answer.findings] == ["mounting"]


@pytest.mark.slow
def test_no_input_is_read_beyond_its_end(
    sanitised_on_board: Build, version_folder: Path, right: RightScan, tmp_path: Path
):
    """Scans of strangers, thinned, tried in other forms under sanitizers."""
    path, rng = tmp_path / "scan.f32", np.random.default_rng(8)
    some = right.points[rows_by_chance(len(right.points), 1500)]
    tried = [points_of(wrong.content(right)) for wrong in WRONG_INPUTS]
    tried += [some, np.full((600, 3), 1e-38), np.repeat(some[:1], 600, axis=0)]
    tried.append(np.where(rng.random(some.shape) < 0.1, [[np.nan, np.inf, 3e38]], some))
    for points in tried:
        if points is None:
            continue
        path.write_bytes(np.asarray(points[rows_by_chance(len(points), 1500)], "<f4").tobytes())
        asked = ("max_candidates=2", "explaining=2", "gravity=0,0,9.81", "prior=0,0,0,1")
        done = sanitised_on_board.run(PROGRAM, version_folder, path, *asked)
        assert done.returncode in EXIT_CODES.values(), done.stderr

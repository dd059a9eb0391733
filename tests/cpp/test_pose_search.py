"""Registered poses without Python: those of a service's first search, and no damaged version is read."""

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

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.candidates import find_candidates
from firstfix.engine.hypotheses import HypothesisSearch
from firstfix.engine.index import MapIndex
from firstfix.engine.preprocess import preprocess
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.engine.with_prior import judging
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.scan_file import read_scan_file
from firstfix.wire.scan import decode_scan, encode_scan
from tests.cpp.cpp_build import Build
from tests.cpp.stored_versions import any_bytes, damaged, rewritten, stored
from tests.needs import recorded

PROGRAM = "firstfix_ranked_poses"
SEEN_FREE = 5  # its column
FILES = (
    "engine.json",
    "calibration.json",
    "surface_fine.safetensors",
    "surface_coarse.safetensors",
    "view_near.safetensors",
    "view_far.safetensors",
    "seen_free.safetensors",
)


@pytest.fixture(scope="module")
def folder(small_version, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The small world's version as it lies in a store, with space that a mapping run saw free."""
    rng = np.random.default_rng(5)
    brick = np.argwhere(rng.random((12, 10, 3)) < 0.3) - [6, 5, 1]
    bits = rng.integers(-(2**31), 2**31, (len(brick), 8, 2)).astype(np.int32)
    built = tmp_path_factory.mktemp("built") / "version"
    shutil.copytree(small_version.directory, built)
    SeenFree.of_bricks(brick, bits, 0.2).save(built)
    return stored(built, tmp_path_factory.mktemp("versions"))


def registered(index: MapIndex, scan: Scan, prior: Prior | None = None) -> list[RegisteredCandidate]:
    """The poses of a service's first search, best first."""
    options = LocalizeOptions(prior=prior)
    index, config = judging(index, options), index.config
    prepared = preprocess(ScanSequence.single(scan), None, config.preprocess, None, config.ranking)
    assert prepared is not None
    described = [one.described_by(index.cascade.descriptor) for one in prepared.scans]
    candidates = find_candidates(index, described, prepared.scans, options)
    search = HypothesisSearch(index, prepared, prior)
    return search.run(candidates, nearby=config.search.widened > 1)


def lines_of(index: MapIndex, found: list[RegisteredCandidate]) -> list[list[float]]:
    """Poses as the program writes them. A pose in the map is summed up in the same order."""
    lines = []
    T_map_level = index.T_map_level.tolist()
    for one in found:
        fit, T = one.quality, one.registration.T_level_sensor.tolist()
        pose = [sum(a[k] * T[k][column] for k in range(4)) for a in T_map_level[:3] for column in range(4)]
        shares = [fit.inlier_ratio, fit.alignment_score, fit.free_space_violation, fit.removed_surface]
        shares += [math.nan if fit.seen_free is None else fit.seen_free, fit.beside_surface, fit.same_plane]
        lines.append([one.support, *shares, float(one.registration.rests), float(one.template), *pose])
    return lines


def numbers_of(done: subprocess.CompletedProcess[str]) -> list[list[float]]:
    assert done.returncode in (0, 4), done.stdout + done.stderr
    return [[float(word) for word in line.split()] for line in done.stdout.splitlines()]


def same(found: list[list[float]], wanted: list[list[float]]) -> bool:
    """Whether all numbers are equal; nan, which is not known, equals nan."""
    return np.array_equal(np.array(found), np.array(wanted), equal_nan=True)


def test_it_registers_what_a_service_registers(on_board: Build, folder: Path, small_scans, tmp_path: Path):
    index = MapIndex.load(folder)
    for number, (scan, T_map_sensor) in enumerate(small_scans[:4]):
        path = tmp_path / f"{number}.f32"
        path.write_bytes(scan.points.astype("<f4").tobytes())
        found = numbers_of(on_board.run(PROGRAM, folder, path))
        assert same(found, lines_of(index, registered(index, scan)))
        assert 0 < found[0][SEEN_FREE] < 1
        assert np.linalg.norm(np.array(found[0])[-12:].reshape(3, 4)[:, 3] - T_map_sensor[:3, 3]) < 0.1
        near = Prior(T_map_sensor[:3, 3] + [0.3, 0, 0], 0.5)
        found = numbers_of(on_board.run(PROGRAM, folder, path, *near.position_m, near.radius_m))
        assert same(found, lines_of(index, registered(index, scan, near)))


def test_a_prior_is_judged_by_the_calibration_of_priors(
    on_board: Build, folder: Path, small_scans, scan_file: Path, tmp_path: Path
):
    """One that accepts nothing keeps poses from fine alignment."""
    usual = MapIndex.load(folder).calibration
    hopeless = replace(usual, with_prior=replace(usual, with_prior=None, bias=-1000.0, cases=100))
    content = json.dumps(hopeless.to_mapping()).encode()
    other = damaged(folder, tmp_path / "other", lambda at: rewritten(at, "calibration.json", content))
    index, (scan, T_map_sensor) = MapIndex.load(other), small_scans[0]
    lines = {}
    for radius_m in (5.0, 20.0):
        near = Prior(T_map_sensor[:3, 3], radius_m)
        found = numbers_of(on_board.run(PROGRAM, other, scan_file, *near.position_m, radius_m))
        assert same(found, lines_of(index, registered(index, scan, near)))
        lines[radius_m] = found[0]
    assert lines[5.0] != lines[20.0]


def test_a_scan_of_too_few_points_has_no_pose(on_board: Build, folder: Path, tmp_path: Path):
    nothing = tmp_path / "nothing.f32"
    nothing.write_bytes(np.zeros((9, 3), "<f4").tobytes())
    done = on_board.run(PROGRAM, folder, nothing)
    assert (done.returncode, done.stdout) == (4, "")


def test_a_scan_in_motion_is_registered_with_its_motion(
    on_board: Build, folder: Path, small_scans, tmp_path: Path
):
    index, path = MapIndex.load(folder), tmp_path / "moving.ffscan"
    for scan, _ in small_scans[:2]:
        azimuth = np.arctan2(scan.points[:, 1], scan.points[:, 0])
        time_s = (azimuth / (2 * np.pi) * 0.1 - 0.05).astype(np.float32)
        path.write_bytes(encode_scan(replace(scan, time_s=time_s)))
        poses = registered(index, decode_scan(path.read_bytes()))
        assert poses[0].registration.twist is not None
        assert same(numbers_of(on_board.run(PROGRAM, folder, path)), lines_of(index, poses))


@pytest.mark.slow
def test_it_registers_what_a_service_registers_in_a_real_hall(on_board: Build, hall_directory: Path):
    index = MapIndex.load(hall_directory)
    for path in sorted((recorded("hilti_hall_indoor") / "queries").glob("*.pcd"))[:6]:
        found = numbers_of(on_board.run(PROGRAM, hall_directory, path))
        assert found
        assert same(found, lines_of(index, registered(index, read_scan_file(path))))


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
    for name in FILES[:-1]:  # a version may have no space that was seen free
        other = damaged(folder, tmp_path / name, lambda at, name=name: (at / name).unlink())
        done = on_board.run(PROGRAM, other, scan_file)
        assert done.returncode == 1
        assert re.search(rf"corrupt_version: .*{re.escape(name)}", done.stderr), done.stderr


def test_a_surface_that_is_not_finite_is_refused(
    on_board: Build, folder: Path, scan_file: Path, tmp_path: Path
):
    name = "surface_fine.safetensors"
    content = bytearray((folder / name).read_bytes())
    header = int.from_bytes(content[:8], "little")
    entry = json.loads(content[8 : 8 + header])["planes"]
    at = 8 + header + entry["data_offsets"][0]
    content[at : at + 4] = np.float32(np.nan).tobytes()
    other = damaged(folder, tmp_path / "nan", lambda at: rewritten(at, name, bytes(content)))
    done = on_board.run(PROGRAM, other, scan_file)
    assert "corrupt_version: surface_fine.safetensors: planes has a number that is not finite" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_files_of_any_bytes_end_in_an_error(
    sanitised_on_board: Build, folder: Path, scan_file: Path, tmp_path: Path, name: str
):
    """The manifest agrees with each, as an attacker's would."""
    content = (folder / name).read_bytes()
    for number, case in enumerate(any_bytes(content, len(name))):
        copy = damaged(folder, tmp_path / str(number), lambda at, case=case: rewritten(at, name, case))
        done = sanitised_on_board.run(PROGRAM, copy, scan_file)
        assert done.returncode in (0, 1, 4), done.stderr
        if done.returncode == 1:
            assert re.match(rf"{PROGRAM}: (corrupt|incompatible)_version: ", done.stderr), done.stderr
        shutil.rmtree(copy)

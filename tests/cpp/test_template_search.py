"""Similar places without Python: those of a service's first search, and no damaged version is read."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.catalog.manifest import FILE_NAME
from firstfix.engine.candidates import Candidates, find_candidates
from firstfix.engine.index import MapIndex
from firstfix.engine.preprocess import preprocess
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.scan_file import read_scan_file
from tests.cpp.cpp_build import Build
from tests.cpp.stored_versions import any_bytes, damaged, rewritten
from tests.needs import recorded

PROGRAM = "firstfix_similar_places"


def proposed(index: MapIndex, scan: Scan, prior: Prior | None = None) -> Candidates | None:
    """The candidates that a service finds; None: the scan has too few points."""
    config = index.config
    prepared = preprocess(ScanSequence.single(scan), None, config.preprocess, None, config.ranking)
    if prepared is None:
        return None
    (only,) = prepared.scans
    described = only.described_by(index.cascade.descriptor)
    return find_candidates(index, described, only, LocalizeOptions(prior=prior))


def lines_of(index: MapIndex, found: Candidates) -> list[list[float]]:
    """Candidates as the program writes them. A pose in the map is summed up in the same order."""
    lines = []
    T_map_level = index.T_map_level.tolist()
    for row, T, score in zip(found.template, found.T_level_sensor.tolist(), found.score, strict=True):
        pose = [sum(a[k] * T[k][column] for k in range(4)) for a in T_map_level[:3] for column in range(4)]
        lines.append([float(score), float(row), *pose])
    return lines


def asked(build: Build, folder: Path, scan: Path, *prior: float) -> subprocess.CompletedProcess[str]:
    return build.run(PROGRAM, folder, scan, *prior)


def numbers_of(done: subprocess.CompletedProcess[str]) -> list[list[float]]:
    assert done.returncode in (0, 4), done.stdout + done.stderr
    return [[float(word) for word in line.split()] for line in done.stdout.splitlines()]


def test_it_finds_what_a_service_finds(on_board: Build, version_folder: Path, small_scans, tmp_path: Path):
    index = MapIndex.load(version_folder)
    for number, (scan, T_map_sensor) in enumerate(small_scans[:4]):
        path = tmp_path / f"{number}.f32"
        path.write_bytes(scan.points.astype("<f4").tobytes())
        assert numbers_of(asked(on_board, version_folder, path)) == lines_of(index, proposed(index, scan))
        near = Prior(T_map_sensor[:3, 3], 2.0)
        found = numbers_of(asked(on_board, version_folder, path, *near.position_m, near.radius_m))
        assert found == lines_of(index, proposed(index, scan, near))
        assert found
    nothing = tmp_path / "nothing.f32"
    nothing.write_bytes(np.zeros((9, 3), "<f4").tobytes())
    done = asked(on_board, version_folder, nothing)
    assert (done.returncode, done.stdout) == (4, "")


@pytest.mark.slow
def test_it_finds_what_a_service_finds_in_a_real_hall(on_board: Build, hall_directory: Path):
    index = MapIndex.load(hall_directory)
    for path in sorted((recorded("hilti_hall_indoor") / "queries").glob("*.pcd"))[:3]:
        assert numbers_of(asked(on_board, hall_directory, path)) == lines_of(
            index, proposed(index, read_scan_file(path))
        )


def test_a_changed_file_is_refused(on_board: Build, version_folder: Path, scan_file: Path, tmp_path: Path):
    def flip(path: Path) -> None:
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes(content)

    for name in ("engine.json", "template_occupancy.npy", "template_tiles.safetensors", "keys.faiss"):
        for number, change in enumerate(
            (flip, lambda path: path.write_bytes(path.read_bytes()[:-1]), Path.unlink)
        ):
            copy = damaged(
                version_folder,
                tmp_path / f"{name}-{number}",
                lambda at, change=change, name=name: change(at / name),
            )
            done = asked(on_board, copy, scan_file)
            assert done.returncode == 1
            assert re.search(rf"corrupt_version: .*{re.escape(name)}", done.stderr), done.stderr


def test_a_manifest_of_another_version_is_refused(
    on_board: Build, version_folder: Path, scan_file: Path, tmp_path: Path
):
    target = tmp_path / version_folder.name
    shutil.copytree(version_folder, target)
    rewritten(target, "engine.json", (target / "engine.json").read_bytes() + b" ")
    assert "corrupt_version: manifest.json is not that of" in asked(on_board, target, scan_file).stderr
    other = damaged(
        version_folder, tmp_path / "other", lambda at: (at / FILE_NAME).write_text(json.dumps({"format": 8}))
    )
    assert "incompatible_version" in asked(on_board, other, scan_file).stderr
    assert "not_found" in asked(on_board, tmp_path / "none", scan_file).stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    [
        "engine.json",
        "template_occupancy.npy",
        "template_tiles.safetensors",
        "keys.faiss",
        "cluster_start.npy",
    ],
)
def test_files_of_any_bytes_end_in_an_error(
    sanitised_on_board: Build, version_folder: Path, scan_file: Path, tmp_path: Path, name: str
):
    """The manifest agrees with each, as an attacker's would."""
    content = (version_folder / name).read_bytes()
    for number, case in enumerate(any_bytes(content, len(name))):
        copy = damaged(
            version_folder, tmp_path / str(number), lambda at, case=case: rewritten(at, name, case)
        )
        done = asked(sanitised_on_board, copy, scan_file)
        assert done.returncode in (0, 1, 4), done.stderr
        if done.returncode == 1:
            assert re.match(rf"{PROGRAM}: (corrupt|incompatible)_version: ", done.stderr), done.stderr
        shutil.rmtree(copy)

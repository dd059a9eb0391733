"""No damaged version is localized in on board, and none is read beyond the ends of its files."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.cpp.cpp_build import Build
from tests.cpp.printed_answers import (
    PROGRAM,
    written,
)
from tests.cpp.stored_versions import (
    any_bytes,
    damaged,
    other_shapes,
    pointing_anywhere,
    rewritten,
    swapped,
)

FILES = (
    "engine.json",
    "calibration.json",
    "surface_fine.safetensors",
    "surface_coarse.safetensors",
    "view_near.safetensors",
    "view_far.safetensors",
)
OPTIONAL_FILES = ("seen_free.safetensors", "aliases.safetensors", "false_accept_bound.json")


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


TABLES = tuple(
    name for name in (*FILES, *OPTIONAL_FILES, "template_tiles.safetensors") if name.endswith("tensors")
)


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_tables_that_point_anywhere_are_never_read_beyond_their_ends(
    sanitised_on_board: Build, folder: Path, small_scans, tmp_path: Path, name: str
):
    """A wrong pointer is refused, or leads to nothing; a wrong shape is refused."""
    path = written(small_scans[0][0], tmp_path / "scan.ffscan")
    content = (folder / name).read_bytes()
    cases = [(True, *case) for case in other_shapes(content)]
    cases += [(False, *case) for case in pointing_anywhere(content, len(name))]
    for number, (is_refused, what, case) in enumerate(cases):
        copy = damaged(folder, tmp_path / str(number), lambda at, case=case: rewritten(at, name, case))
        done = sanitised_on_board.run(PROGRAM, copy, path, "max_candidates=2")
        assert done.returncode in ((1,) if is_refused else (0, 1, 3, 4)), (what, done.stderr)
        if done.returncode == 1:
            assert re.match(rf"{PROGRAM}: corrupt_version: ", done.stderr), (what, done.stderr)
        shutil.rmtree(copy)


@pytest.mark.slow
def test_files_in_one_anothers_place_end_in_an_error_or_an_answer(
    sanitised_on_board: Build, folder: Path, small_scans, tmp_path: Path
):
    path = written(small_scans[0][0], tmp_path / "scan.ffscan")
    alike = (
        ("surface_fine.safetensors", "surface_coarse.safetensors"),
        ("view_near.safetensors", "view_far.safetensors"),
    )
    others = (
        ("surface_fine.safetensors", "view_near.safetensors"),
        ("engine.json", "calibration.json"),
        ("template_position_m.npy", "template_height_m.npy"),
        ("cluster_start.npy", "cluster_member.npy"),
        ("keys.faiss", "template_occupancy.npy"),
    )
    for number, (first, second) in enumerate((*alike, *others)):
        copy = damaged(folder, tmp_path / str(number), lambda at, a=first, b=second: swapped(at, a, b))
        done = sanitised_on_board.run(PROGRAM, copy, path)
        if (first, second) in alike:  # of the same form: of another map, for all that the files tell
            assert done.returncode in (0, 3, 4), done.stderr
        else:
            assert re.match(rf"{PROGRAM}: (corrupt|incompatible)_version: ", done.stderr), done.stderr

"""Several maps on board: one search over all, with the answers of a service."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.diagnosis import diagnose
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer, localize_among
from firstfix.errors import InvalidOption
from firstfix.scan.condense import condense
from firstfix.scan.scan import Scan
from firstfix.wire.query import decode_query, encode_query
from firstfix.wire.scan import decode_scan, encode_scan
from firstfix.wire.sequence import decode_scans, encode_scans
from tests.cpp.cpp_build import Build
from tests.cpp.printed_answers import PROGRAM, findings_of, in_time, noise, of_one_side, printed, same
from tests.cpp.stored_versions import stored
from tests.once_a_run import OnceARun
from tests.storey_world import storey_version


@pytest.fixture(autouse=True)
def _time_for_all_forms(monkeypatch: pytest.MonkeyPatch) -> None:
    """Which forms are tried depends on how fast they are: both try all of them."""
    monkeypatch.setattr(diagnose, "MAX_TIME", math.inf)


@pytest.fixture(scope="module")
def folders(folder: Path, once_a_run: OnceARun, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Versions of a yard and a storey, and the yard's once more."""
    storey = stored(storey_version(once_a_run).directory, tmp_path_factory.mktemp("storey"))
    return {"yard": folder, "storey": storey, "copy": folder}


def on_board_of(folders: Mapping[str, Path], *ids: str) -> str:
    """The maps as the program is given them."""
    return ",".join(f"{one}={folders[one]}" for one in ids)


def of_service(answer: Localization, maps: Mapping[str, Localizer]) -> Localization:
    """The answer with the map that a service names."""
    first = answer.hypotheses[0].map_id if answer.hypotheses else next(iter(maps))
    return answer.of_version(first, "", provisional=False)


def test_scans_are_answered_as_by_a_service(
    on_board: Build, folders: dict[str, Path], small_scans, tmp_path: Path
):
    localizers = {one: Localizer(MapIndex.load(at)) for one, at in folders.items()}
    (scan, T), (other, T_other) = small_scans[:2]
    bodies = {
        "as it is": encode_scan(scan),
        "in time": encode_scan(in_time(scan)),
        "of one side": encode_scan(of_one_side(other, 60)),
        "mirrored": encode_scan(Scan(scan.points * np.float32([1, -1, 1]))),
        "noise": encode_scan(noise(scan)),
        "too few": encode_scan(Scan(scan.points[:20])),
        "compact": encode_query(condense(other)),
        "way": encode_scans([other, scan], [T_other, T]),
    }
    path, answered = tmp_path / "scan.ffscan", set()
    few = {"min_probability": "0.2", "max_candidates": "8"}
    for ids, asked in (
        (("yard", "storey"), {}),
        (("storey",), few),
        (("copy", "storey", "yard"), few),
    ):
        maps = {one: localizers[one] for one in ids}
        for name, body in bodies.items():
            path.write_bytes(body)
            decode = decode_scans if name == "way" else decode_query if name == "compact" else decode_scan
            answer = localize_among(maps, decode(body), LocalizeOptions.from_strings(asked))
            options = [f"{key}={value}" for key, value in asked.items()]
            done = on_board.run(PROGRAM, on_board_of(folders, *ids), path, *options, "explaining=inf")
            assert same(printed(done), of_service(answer, maps)), (ids, name)
            assert done.stderr == findings_of(answer), (ids, name)
            answered.add((answer.verdict.value, answer.map_id))
    assert answered >= {("localized", "yard"), ("ambiguous", ""), ("rejected", "")}


def test_options_of_one_map_are_refused(
    on_board: Build, folders: dict[str, Path], small_scans, scan_file: Path
):
    maps = {one: Localizer(MapIndex.load(folders[one])) for one in ("yard", "storey")}
    for wrong in ({"prior": "0,0,0,5"}, {"max_false_accept": "0.0"}):
        with pytest.raises(InvalidOption) as refused:
            localize_among(maps, small_scans[0][0], LocalizeOptions.from_strings(wrong))
        asked = [f"{key}={value}" for key, value in wrong.items()]
        done = on_board.run(PROGRAM, on_board_of(folders, "yard", "storey"), scan_file, *asked)
        assert (done.returncode, done.stderr) == (1, f"{PROGRAM}: invalid_option: {refused.value}\n"), wrong


def test_maps_of_one_name_and_too_many_are_refused(
    on_board: Build, folders: dict[str, Path], scan_file: Path
):
    many = ",".join(f"{number}={folders['yard']}" for number in range(17))
    for maps in (on_board_of(folders, "yard", "yard"), many):
        assert "invalid_option: a localizer has 1 to 16 maps" in on_board.run(PROGRAM, maps, scan_file).stderr


@pytest.mark.slow
def test_a_hall_and_a_yard_are_told_apart(
    on_board: Build, folders: dict[str, Path], hall_directory: Path, small_scans, tmp_path: Path
):
    at = {**folders, "hall": hall_directory}
    maps = {one: Localizer(MapIndex.load(at[one])) for one in ("hall", "yard")}
    path = tmp_path / "scan.ffscan"
    for scan, _ in small_scans[:3]:
        path.write_bytes(encode_scan(scan))
        answer = localize_among(maps, decode_scan(path.read_bytes()))
        done = on_board.run(PROGRAM, on_board_of(at, "hall", "yard"), path, "explaining=inf")
        assert same(printed(done), of_service(answer, maps))
        assert answer.map_id == "yard"


def test_the_path_of_a_lone_folder_may_have_an_equals_sign(
    on_board: Build, folder: Path, scan_file: Path, tmp_path: Path
):
    named = tmp_path / "run=3"
    named.symlink_to(folder)
    said = on_board.run(PROGRAM, named, scan_file).stdout
    assert "\nmap " not in said
    assert said == on_board.run(PROGRAM, folder, scan_file).stdout

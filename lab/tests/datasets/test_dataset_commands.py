"""``firstfix dataset`` and ``evaluate --dataset``, from recordings to figures."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_builder.sources.read_map import read_map
from firstfix_cli.main import run
from lab.tests.datasets.dataset_files import write_hilti, write_mulran, write_recorded


def exit_code(*arguments: object) -> int:
    with pytest.raises(SystemExit) as ended:
        run([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.mark.timeout(900)
def test_scans_of_a_recording_are_localized(small_version, small_scans, tmp_path: Path, capsys):
    store = tmp_path / "store"
    Catalog(Store.open(str(store))).publish("yard", small_version.directory, small_version.manifest)
    drive = write_mulran(tmp_path, small_scans)
    code = exit_code(
        "evaluate", drive, "--dataset", "mulran", "--map", "yard", "--store", store,
        "--spacing", "0.5", "--random-yaw", "0", "--json", "-",
    )  # fmt: skip
    assert code == 0
    said = capsys.readouterr()
    report = json.loads(said.out)
    assert 10 <= report["n"] <= len(small_scans)
    assert f"{report['n']} of {len(small_scans)} scans, one from each 0.5 m square" in said.err
    assert report["first_0.2m"] > 0.8
    assert report["false_accept_rate"] == 0


def test_a_map_of_a_recording(small_scans, tmp_path: Path, capsys):
    bag = write_hilti(tmp_path, small_scans[:4])
    assert exit_code("dataset", "hilti", bag, "-o", tmp_path / "map", "--spacing", "0.1") == 0
    assert "points of 4 scans" in capsys.readouterr().out
    found = read_map(tmp_path / "map")
    assert found.points is not None
    assert found.trajectory is not None
    assert len(found.trajectory) == 4
    # The yard is 16 x 12 m with a wall of 3 m round it.
    assert (found.points.min(axis=0) > [-8.5, -6.5, -0.5]).all()
    assert (found.points.max(axis=0) < [8.5, 6.5, 3.5]).all()
    assert exit_code("dataset", "hilti", bag, "-o", tmp_path / "map") == 2
    assert "is there already" in capsys.readouterr().err


def test_a_map_of_any_recording_that_was_cut_off(small_scans, tmp_path: Path, capsys):
    """Its clouds are a Livox's, and its recorder was killed before it wrote the description."""
    bag = write_recorded(tmp_path, small_scans[:6])
    (bag / "metadata.yaml").unlink()
    assert exit_code("dataset", "recording", bag, "-o", tmp_path / "map", "--spacing", "0.01") == 0
    said = capsys.readouterr()
    assert "cut off" in said.err
    assert "points of 6 scans" in said.out
    found = read_map(tmp_path / "map")
    assert found.points is not None
    assert (found.points.min(axis=0) > [-8.5, -6.5, -0.5]).all()
    assert (found.points.max(axis=0) < [8.5, 6.5, 3.5]).all()
    bag.with_name(f"{bag.name}.tum").unlink()
    assert exit_code("dataset", "recording", bag, "-o", tmp_path / "other") == 2
    assert f"no trajectory {bag.name}.tum beside it" in capsys.readouterr().err


def test_a_damaged_recording_leaves_no_folder(small_scans, tmp_path: Path, capsys):
    drive = write_mulran(tmp_path, small_scans[:3])
    sorted((drive / "Ouster").glob("*.bin"))[1].write_bytes(b"123")
    assert exit_code("dataset", "mulran", drive, "-o", tmp_path / "map", "--spacing", "0.01") == 2
    assert ".bin" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [drive]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["evaluate", "none", "--dataset", "nclt", "--map", "m"], "none: no such folder"),
        (["evaluate", "--dataset", "nclt", "--recorded", "s", "--map", "m"], "--dataset needs the folder"),
        (["evaluate", "poses.csv", "--lidar", "Ouster", "--map", "m"], "--lidar needs --dataset"),
        (["dataset", "nclt", "none", "-o", "map"], "none: no such folder"),
    ],
)
def test_wrong_use(arguments, said, capsys, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert exit_code(*arguments) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []

"""The lab as a user has it: an evaluation, a world, and the one entrance."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_cli.sample_world import WorldQuery
from firstfix_cli.sample_world.write_world import write_queries
from firstfix_lab.entrance import DRILLS, FIGURES, PROGRAMS, main
from firstfix_lab.worlds import WRITERS
from tests.cli.fixtures import ended


def test_scans_with_known_poses_are_evaluated(small_version, small_scans, tmp_path: Path, capsys):
    Catalog(Store.open(str(tmp_path / "store"))).publish(
        "yard", small_version.directory, small_version.manifest
    )
    write_queries(tmp_path / "world", [WorldQuery(scan, T) for scan, T in small_scans[:6]])
    arguments = ["evaluate", str(tmp_path / "world/poses.csv"), "--map", "yard"]
    assert (
        ended([*arguments, "--store", str(tmp_path / "store"), "--json", str(tmp_path / "figures.json")]) == 0
    ), capsys.readouterr().err
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert figures["verdicts"]["localized"] == figures["n"] == 6
    assert figures["first_0.2m"] == 1
    assert figures["median_error_m"] < 0.02


def test_the_worlds_of_the_lab_come_through_the_door(tmp_path: Path, capsys):
    assert {"factory", "office", "campus", "farm", "city"} == set(WRITERS)
    assert ended(["world", "farm", "-o", tmp_path, "--extent", "400"]) == 2
    assert "only a city has an extent" in capsys.readouterr().err
    assert ended(["world", "city", "-o", tmp_path, "--extent", "20"]) == 2
    assert "80 to 20000 m" in capsys.readouterr().err
    assert ended(["world", "city", "-o", tmp_path / "city", "--extent", "80"]) == 0
    assert len(list((tmp_path / "city" / "mesh").iterdir())) == 1
    assert len(list((tmp_path / "city" / "scans").iterdir())) == 26


def test_the_entrance_knows_every_suite_and_drill():
    for name in FIGURES:
        folder = "drills" if name == "hostile" else "suites"
        assert callable(import_module(f"firstfix_lab.{folder}.{name}.suite").run)
    for module in (*PROGRAMS.values(), *(f"firstfix_lab.drills.{name}" for name in DRILLS)):
        assert callable(import_module(module).main)


def test_an_unknown_suite_is_refused_with_the_list(capsys):
    assert main(["nothing"]) == 2
    assert "power_cuts" in capsys.readouterr().err

"""The time from the submission of a map to the first scan that is localized in it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from firstfix_cli.sample_world.write_world import write_world
from firstfix_lab.checkout import ROOT
from firstfix_lab.suites.first_answer import program
from firstfix_lab.worlds import make_world


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_map_is_submitted_and_asked_until_it_answers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(program, "SETTLE_S", 0.0)
    world = make_world("factory")
    write_world(world, tmp_path)
    config = {"sensor": world.sensor.to_mapping(), "reconstruct": {"surface": "signed-distance"}}
    map_, run, scan = (str(tmp_path / name) for name in ("map.ply", "trajectory.txt", "scans/000.pcd"))
    given = ["--trajectory", run, "--scan", scan, "--config", json.dumps(config), "--rounds", "1"]
    program.main([map_, *given, "--json", str(tmp_path / "figures.json")])
    (found,) = json.loads((tmp_path / "figures.json").read_text())[str(ROOT)]
    assert found["wall_s"] > 0
    assert found["cpu_s"] > 0


def test_a_scan_is_sent_as_what_its_name_says():
    assert program._media_type(Path("a.PCD")) == "application/x-pcd"

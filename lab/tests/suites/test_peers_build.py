"""Two versions of one map for the comparison: each stays as it was built."""

from __future__ import annotations

import shutil
from pathlib import Path
from types import SimpleNamespace

import pytest

from firstfix_lab.suites.peers import build as module
from tests.recorded_data import Dataset, PoseTable


class Pipe:
    """Keeps the last thing that was sent."""

    def send(self, folder: Path) -> None:
        self.sent = folder


def test_a_second_build_leaves_the_first_version_as_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def build_version(source, config, work, trajectory):
        directory = work / "version"  # as the builder does: anew, in the same place
        shutil.rmtree(directory, ignore_errors=True)
        directory.mkdir(parents=True)
        (directory / "method").write_text(config.engine.method)
        return SimpleNamespace(directory=directory)

    monkeypatch.setattr(module, "build_version", build_version)
    monkeypatch.setattr(Dataset, "write_trajectory", lambda self, path: path)
    tables = {"truth": PoseTable("eval.csv")}, PoseTable("trajectory.csv")
    dataset = Dataset("place", ".", "", "{}", *tables, "vlp-16", root=tmp_path)
    built = {}
    for name, engine in (("ours", {}), ("paper", {"method": "paper"})):
        pipe = Pipe()
        module._build(pipe, dataset, engine, tmp_path, name)
        built[name] = pipe.sent
    assert (built["ours"] / "method").read_text() == "default"
    assert (built["paper"] / "method").read_text() == "paper"

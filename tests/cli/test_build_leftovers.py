"""A build on this machine that fails leaves no scans of robots in its work folder."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery, new_query_id
from firstfix.errors import BuildFailed
from firstfix.store.store import Store
from firstfix_builder.job.confirmed_queries import CONFIRMED_FILE
from firstfix_builder.sources.read_map.held_out import HeldOut
from firstfix_cli.main import app


def keep_confirmed(store: Path) -> None:
    now, body = datetime.now(timezone.utc), np.ones((60, 3), "<f4").tobytes()
    answer = {"verdict": "ambiguous", "reasons": [], "probability": 0.4}
    query_id = new_query_id("0000000a", now)
    recorded = RecordedQuery(
        query_id, now.isoformat(), "http", "r", "", "hall", "application/vnd.firstfix.xyz", "", {},
        answer, len(body),
    )  # fmt: skip
    recorded_queries = RecordedQueries(Store.open(str(store)))
    recorded_queries.put(recorded, body)
    pose = {"position": [0.0, 0.0, 1.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}
    recorded_queries.set_truth(query_id, {"map_id": "hall", "T_map_sensor": pose})


def test_a_build_that_fails_leaves_no_scans_of_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    keep_confirmed(tmp_path / "store")
    work, source = tmp_path / "work", tmp_path / "room.ply"
    trimesh.creation.box((6, 6, 3)).export(source)
    seen = []

    def fail(source: Path, config: Any, folder: Path, *, confirmed: Path, **_: Any) -> None:
        seen.append((confirmed / CONFIRMED_FILE).exists())
        seen.append(len(HeldOut.load(folder / "confirmed").scans))
        raise BuildFailed("no floor")

    monkeypatch.setattr("firstfix_builder.pipeline.build_version", fail)
    options = ["--map-id", "hall", "--store", str(tmp_path / "store"), "--work", str(work)]
    ended = CliRunner().invoke(app, ["build", str(source), *options])
    assert isinstance(ended.exception, BuildFailed)
    assert seen == [True, 1], "it was collected, and decoded by the sandbox"
    assert not list(work.rglob(CONFIRMED_FILE))
    assert not list(work.rglob("held_out.npz"))

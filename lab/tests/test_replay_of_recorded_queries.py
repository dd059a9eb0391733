"""Recorded queries are asked again, of the service and of the engine in the command's process."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.engine.index import MapIndex
from firstfix.scan.scan import Scan
from tests.commands import firstfix
from tests.service.localize.test_query_recorder import judged, query_id, recorded_by, service
from tests.service.service_world import FakeLocalizer, Service, publish
from tests.waiting import wait_until

__all__ = ["query_id", "service"]


def replayed(service: Service, *more: object, map_id: str = "hall") -> str:
    store = service.settings.store
    return firstfix("evaluate", "--recorded", store, "--map", map_id, "--url", service.url, *more).out


def test_recorded_queries_are_replayed(service, query_id, tmp_path):
    def better(localizer: FakeLocalizer, scan: Scan, *_: object) -> Localization:
        assert len(scan) == 100, "the same bytes"
        T = np.eye(4)
        T[:3, 3] = localizer.label + 3, 4, 0
        return Localization(Verdict.LOCALIZED, (), T, None, np.eye(6), 0.99)

    service.behaviour.answers = better
    report = tmp_path / "report.json"
    out = replayed(service, "--json", report)
    assert "rejected -> localized: 1" in out
    assert "moved 5.00 m, 0.0 deg" in out
    found = json.loads(report.read_text())
    assert found["n"] == 1
    assert found["changes"] == [{"then": "rejected", "now": "localized", "n": 1}]
    (one,) = found["queries"]
    assert (one["query"], one["moved_m"]) == (query_id, 5.0)
    assert (one["then"]["probability"], one["now"]["probability"]) == (0.4, 0.99)
    assert one["now"]["map_version"] == service.catalog.active_version("hall")
    service.behaviour.answers = judged
    service.ask("http")  # recorded after the replay would have been
    wait_until(lambda: len(recorded_by(service).ids()) > 1)
    assert len(recorded_by(service).ids()) == 2, "the replay is not recorded"


def test_another_version_can_be_replayed(service, query_id):
    first = service.catalog.active_version("hall")
    publish(service.catalog, "hall", "2", service.scratch)
    assert "moved 0.00 m" in replayed(service, "--version", first)
    assert "rejected -> error: 1" in replayed(service, "--version", "0" * 64)
    assert "0 recorded queries sent again" in replayed(service, map_id="yard")
    wait_until(lambda: service.ask("http").json["hypotheses"][0]["T_map_sensor"]["position"][0] == 2)
    assert "moved 1.00 m" in replayed(service)


def test_the_engine_in_this_process_can_be_asked(service, query_id, monkeypatch):
    monkeypatch.setattr(MapIndex, "load", lambda directory: float((directory / "label.txt").read_text()))
    monkeypatch.setattr(
        "firstfix.engine.localizer.Localizer", lambda label: FakeLocalizer(label, service.behaviour)
    )
    publish(service.catalog, "hall", "4", service.scratch)
    store = service.settings.store
    out = firstfix("evaluate", "--recorded", store, "--map", "hall", "--store", store).out
    assert "rejected -> rejected: 1" in out
    assert "moved 3.00 m" in out


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("poses.csv", "--recorded", "there"),
        ("--recorded", "there", "--plot", "x.png"),
        ("--recorded", "there", "--url", "http://127.0.0.1:1", "--store", "here"),
    ],
)
def test_options_that_exclude_each_other_are_refused(tmp_path: Path, arguments: tuple[str, ...], monkeypatch):
    monkeypatch.chdir(tmp_path)
    firstfix("evaluate", "--map", "hall", *arguments, code=2)


def test_the_old_name_of_the_option_names_the_new_one(tmp_path: Path):
    for command in (["evaluate"], ["export", tmp_path / "a.mcap"]):
        error = firstfix(*command, "--map", "hall", "--samples", "there", code=2).error
        assert "--samples is now: --recorded" in error

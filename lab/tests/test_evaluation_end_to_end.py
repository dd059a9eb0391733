"""An evaluation of a built map: over HTTP, over zenoh, and with the engine in the command's process."""

from __future__ import annotations

import json

import pytest

from tests.commands import firstfix
from tests.e2e.test_command_line import PLACE, shop, ways

__all__ = ["shop"]


def test_an_evaluation_over_the_service_with_its_picture(shop, tmp_path):
    figures, picture = tmp_path / "figures.json", tmp_path / "picture.png"
    told = firstfix(
        "evaluate", shop.poses, "--map", PLACE, *ways(shop)["http"], "--store", shop.store,
        "--random-yaw", 3, "--json", figures, "--plot", picture,
    ).out  # fmt: skip
    assert "8 scans" in told
    report = json.loads(figures.read_text())
    assert report["n"] == 8
    # how many are accepted hangs on the calibration; every accepted one is right
    assert report["success_0.05m"] == report["verdicts"]["localized"] / 8 >= 0.5
    assert report["false_accept_rate"] == 0
    assert report["median_error_m"] < 0.05
    assert picture.stat().st_size > 50_000


def test_zenoh_and_the_engine_agree_with_http(shop, tmp_path):
    reports = []
    for way in ("http", "zenoh", "store"):
        file = tmp_path / f"{way}.json"
        firstfix("evaluate", shop.poses, "--map", PLACE, *ways(shop)[way], "--json", file)
        reports.append(json.loads(file.read_text()))
    for report in reports:
        report.pop("ms")
    # the wire rounds to 1 cm what the engine in this process sees as it is
    assert reports[0] == reports[1]
    assert reports[0]["verdicts"] == reports[2]["verdicts"]
    assert reports[0]["median_error_m"] == pytest.approx(reports[2]["median_error_m"], abs=0.005)

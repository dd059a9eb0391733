"""The console in a real browser: recorded queries."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
from typer.testing import CliRunner

from firstfix.scan.scan import Scan
from firstfix.wire.scan import encode_scan
from firstfix_cli.main import app
from plugins.console.tests.scans import (
    localized_scan,
)
from tests.waiting import wait_until

pytestmark = pytest.mark.slow


def test_a_recorded_query_is_looked_at_judged_and_exported(page, world, tmp_path):
    file, _, _ = localized_scan(world)
    world.ask(file)
    rng = np.random.default_rng(1)
    elsewhere = tmp_path / "elsewhere.ffscan"
    elsewhere.write_bytes(encode_scan(Scan.from_points(rng.uniform(-6, 6, (4000, 3)))))
    assert world.ask(elsewhere)["verdict"] == "rejected"
    wait_until(lambda: {one["answer"]["verdict"] for one in world.recorded()} >= {"localized", "rejected"})

    page.open("#/recorded-queries")
    page.choose("Map", "yard")
    page.wait("th[aria-sort=descending]", "When")
    verdicts = "[...document.querySelectorAll('td[data-name=Verdict]')].map((e) => e.innerText)"
    for order, is_down in (("ascending", False), ("descending", True)):
        page.click("th button", "Verdict")
        page.wait(f"th[aria-sort={order}]", "Verdict")
        listed = page.js(verdicts)
        assert set(listed) >= {"localized", "rejected"}
        assert listed == sorted(listed, reverse=is_down)

    page.choose("Verdict", "rejected")
    page.until("!find('td .verdict', 'localized') && !!find('td .verdict', 'rejected')")
    page.click("tr a", "Look")
    page.wait(".answer .verdict", "rejected")
    page.click("button", "Not in this map")
    page.wait("[role=status]", "Noted")

    page.open("#/recorded-queries")
    page.choose("Map", "yard")
    page.wait("td", "not in the map")
    page.choose("Verdict", "localized")
    page.until("!find('td .verdict', 'rejected')")
    page.click("tr a", "Look")
    page.wait(".answer .verdict", "localized")
    page.click("button", "At the place shown")
    page.wait("[role=status]", "Noted")

    page.open("#/recorded-queries")
    page.choose("Map", "yard")
    page.wait("td", "known")
    page.click("button", "Export")
    with zipfile.ZipFile(page.downloaded("yard-test-set.zip")) as archive:
        archive.extractall(tmp_path / "set")
    command = ["evaluate", str(tmp_path / "set/poses.csv"), "--map", "yard", "--json", "-"]
    command += ["--store", world.service.settings.store]
    said = CliRunner().invoke(app, command)
    assert said.exit_code == 0, said.output
    figures = json.loads(said.output)
    assert figures["n"] == 2, figures

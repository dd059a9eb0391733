"""The documented way from an empty engine to the first fix: deploy/smoke.sh, profile minimal."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from tests.deploy.engine import ROOT, build_images, compose, docker
from tests.servers import free_port


@pytest.mark.slow
@pytest.mark.timeout(3600)  # images are built, and a version of a map
def test_the_minimal_profile_builds_and_localizes(engine: None, tmp_path: Path):
    compose()
    build_images("service", "builder")
    settings = {
        "FIRSTFIX_HTTP_PORT": str(free_port()),
        "FIRSTFIX_ZENOH_PORT": str(free_port()),
        "JSON": str(tmp_path / "figures.json"),
    }
    done = subprocess.run(
        [ROOT / "deploy/smoke.sh", "minimal"],
        env={**os.environ, **settings},
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    figures = json.loads((tmp_path / "figures.json").read_text())
    assert {way: figures["once"][way]["failed"] for way in ("http", "zenoh")} == {"http": 0, "zenoh": 0}
    assert docker("ps", "-aq", "--filter", "name=^firstfix-smoke-minimal") == ""

"""Containers under fire: deploy/smoke.sh with the profile full, three times; quick: minimal, once."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

SCRIPT = Path(__file__).parents[1] / "deploy" / "smoke.sh"
RUNS = 3


def run(quick: bool) -> dict[str, Any]:
    """What the robots of each run saw. Needs a Docker engine; BUILD=1 makes the images first.

    Raises:
        CalledProcessError: a run was not green.
    """
    profile = "minimal" if quick else "full"
    return {"profile": profile, "runs": [_once(profile) for _ in range(1 if quick else RUNS)]}


def _once(profile: str) -> dict[str, Any]:
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        figures = Path(folder) / "figures.json"
        subprocess.run([SCRIPT, profile], env={**os.environ, "JSON": str(figures)}, check=True)
        return {"seconds": round(time.monotonic() - begin), **json.loads(figures.read_text())}

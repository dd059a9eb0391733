"""Kills containers of the compose deployment while robots ask: deploy/smoke.sh, with figures.

    firstfix-lab smoke [--quick] [--json FILE]

Runs the profile full three times; with --quick the profile minimal once. Needs a Docker engine; BUILD=1
makes the images first.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from firstfix_lab.checkout import ROOT

SCRIPT = ROOT / "deploy" / "smoke.sh"
RUNS = 3


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab smoke", description=__doc__.split("\n\n")[0])
    parser.add_argument("--quick", action="store_true", help="the profile minimal, once")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args(arguments)
    profile = "minimal" if chosen.quick else "full"
    try:
        runs = [run_once(profile) for _ in range(1 if chosen.quick else RUNS)]
    except subprocess.CalledProcessError as error:
        print(error)
        return 1
    text = json.dumps({"profile": profile, "runs": runs}, indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")
    return 0


def run_once(profile: str) -> dict[str, Any]:
    """The figures of the robots during one run.

    Raises:
        CalledProcessError: the script found a fault.
    """
    begin = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        figures = Path(folder) / "figures.json"
        subprocess.run([SCRIPT, profile], env={**os.environ, "JSON": str(figures)}, check=True)
        return {"seconds": round(time.monotonic() - begin), **json.loads(figures.read_text())}

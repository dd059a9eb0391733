"""``firstfix-lab calibration_parts``: see ``suite``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from .suite import FITTED_WORLDS, SCANS, WORK, measure


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab calibration_parts", description="Fits the calibration's prior."
    )
    parser.add_argument(
        "--work", type=Path, default=WORK, metavar="DIR", help="versions and cases are kept here"
    )
    parser.add_argument("--world", action="append", choices=[world.name for world in FITTED_WORLDS])
    parser.add_argument("--scans", type=int, default=SCANS, help="of each kind in each scenery of a world")
    parser.add_argument("--again", action="store_true", help="ask the engine again")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    arguments = parser.parse_args(argv)
    worlds = [one for one in FITTED_WORLDS if arguments.world is None or one.name in arguments.world]
    text = json.dumps(measure(worlds, arguments.scans, arguments.work, again=arguments.again), indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")

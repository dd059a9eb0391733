"""One part of the suite, or with finished parts in another folder: ``firstfix-lab scale_parts --help``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from .extent import BY_DEFAULT, EXTENTS
from .suite import SCANS, WORK, measure


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="firstfix-lab scale_parts", description=__doc__)
    parser.add_argument("--work", type=Path, default=WORK, help="where what is built lies, and stays")
    parser.add_argument(
        "--world", action="append", choices=list(EXTENTS), help="only this; may be repeated [default: all]"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args(argv)
    extents = {name: EXTENTS[name] for name in chosen.world or BY_DEFAULT}
    text = json.dumps(measure(extents, chosen.work, SCANS), indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")

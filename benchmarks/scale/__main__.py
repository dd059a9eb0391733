"""One part of the suite, or with finished parts in another folder: ``python -m benchmarks.scale --help``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from .build import make_world_templates
from .extent import EXTENTS
from .suite import SCANS, WORK, measure


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.scale", description=__doc__)
    parser.add_argument("--work", type=Path, default=WORK, help="where what is built lies, and stays")
    parser.add_argument("--world", action="append", choices=list(EXTENTS), help="only this; may be repeated")
    parser.add_argument("--templates", action="store_true", help="make the templates, and no more")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args()
    extents = {name: EXTENTS[name] for name in chosen.world or EXTENTS}
    if chosen.templates:
        for extent in extents.values():
            make_world_templates(extent, chosen.work)
    else:
        text = json.dumps(measure(extents, chosen.work, SCANS), indent=1)
        print(text)
        if chosen.json:
            chosen.json.write_text(text + "\n")


if __name__ == "__main__":
    main()

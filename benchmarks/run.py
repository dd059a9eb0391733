"""Runs an evaluation suite: ``python -m benchmarks.run SUITE [--quick] [--json FILE]``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from .encodings import suite as encodings
from .hostile import suite as hostile
from .paper import suite as paper
from .peers import suite as peers
from .real import suite as real
from .retrieval import suite as retrieval
from .robust import suite as robust
from .scale import suite as scale
from .service import suite as service

SUITES = {
    "encodings": encodings.run,
    "hostile": hostile.run,
    "paper": paper.run,
    "peers": peers.run,
    "real": real.run,
    "retrieval": retrieval.run,
    "robust": robust.run,
    "scale": scale.run,
    "service": service.run,
}


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.run", description="Runs an evaluation suite.")
    parser.add_argument("suite", choices=sorted(SUITES))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    arguments = parser.parse_args()
    figures = SUITES[arguments.suite](arguments.quick)
    text = json.dumps(figures, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")


if __name__ == "__main__":
    main()

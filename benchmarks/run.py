"""Runs an evaluation suite: ``python -m benchmarks.run SUITE [--quick] [--json FILE]``.

The suite ``native`` takes another checkout, too: ``--beside DIR [--parts street,factory,campus]``.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from .encodings import suite as encodings
from .hints import suite as hints
from .hostile import suite as hostile
from .native import suite as native
from .paper import suite as paper
from .peers import suite as peers
from .real import suite as real
from .retrieval import suite as retrieval
from .robust import suite as robust
from .scale import suite as scale
from .service import suite as service

SUITES = {
    "encodings": encodings.run,
    "hints": hints.run,
    "hostile": hostile.run,
    "native": native.run,
    "paper": paper.run,
    "peers": peers.run,
    "real": real.run,
    "retrieval": retrieval.run,
    "robust": robust.run,
    "scale": scale.run,
    "service": service.run,
}


def _parts(names: str) -> tuple[str, ...]:
    parts = tuple(names.split(","))
    if unknown := set(parts) - set(native.PARTS):
        raise argparse.ArgumentTypeError(f"no such part: {', '.join(sorted(unknown))}")
    return parts


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.run", description="Runs an evaluation suite.")
    parser.add_argument("suite", choices=sorted(SUITES))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--beside", type=Path, metavar="DIR", help="native: another checkout, asked in turns")
    parser.add_argument(
        "--parts", type=_parts, default=(), metavar="NAMES", help=f"native: some of {','.join(native.PARTS)}"
    )
    arguments = parser.parse_args()
    if arguments.suite == "native":
        figures = native.run(arguments.quick, arguments.beside, arguments.parts)
    elif arguments.beside or arguments.parts:
        parser.error("--beside and --parts belong to the suite native")
    else:
        figures = SUITES[arguments.suite](arguments.quick)
    text = json.dumps(figures, indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")


if __name__ == "__main__":
    main()

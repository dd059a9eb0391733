"""``python -m benchmarks.retrieval``: some worlds, some pieces."""

from __future__ import annotations

import argparse
from dataclasses import replace

from ..common.worlds import WORLDS
from .suite import FULL, NAMES, PIECES, WORK, measure


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.retrieval", description="Parts of the retrieval suite.")
    parser.add_argument("--world", action="append", choices=[world.name for world in WORLDS])
    parser.add_argument("--piece", action="append", choices=PIECES)
    parser.add_argument("--queries", type=int, default=FULL.queries, help="of every row")
    parser.add_argument("--spacing", type=float, metavar="M", help="of the templates")
    arguments = parser.parse_args()
    worlds = [world for world in WORLDS if world.name in (arguments.world or NAMES)]
    pieces = arguments.piece or PIECES
    measure(worlds, pieces, replace(FULL, queries=arguments.queries), WORK, arguments.spacing)
    print((WORK / "report.md").read_text())


if __name__ == "__main__":
    main()

"""``python -m benchmarks.robust``: some worlds, some cases, so many queries."""

from __future__ import annotations

import argparse

from ..common.worlds import WORLDS
from .cases import CASES, Sizes
from .suite import WORK, measure


def main() -> None:
    parser = argparse.ArgumentParser(prog="benchmarks.robust", description="Parts of the robust suite.")
    parser.add_argument("--world", action="append", choices=[world.name for world in WORLDS])
    parser.add_argument("--case", action="append", choices=[case.name for case in CASES])
    parser.add_argument("--queries", type=int, default=50, help="of each case")
    arguments = parser.parse_args()
    worlds = [world for world in WORLDS if arguments.world is None or world.name in arguments.world]
    cases = [case for case in CASES if arguments.case is None or case.name in arguments.case]
    count = arguments.queries
    measure(worlds, cases, Sizes(count, count, count), WORK, others=WORLDS)
    print((WORK / "report.md").read_text())


if __name__ == "__main__":
    main()

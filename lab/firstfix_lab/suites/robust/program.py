"""``firstfix-lab robust_parts``: some worlds, some cases, so many queries, and a report over all parts."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence

from ...common.worlds import WORLDS
from .cases import CASES, FULL, Sizes
from .suite import WORK, measure_in_processes, summarize


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab robust_parts", description="Parts of the robust suite."
    )
    parser.add_argument("--world", action="append", choices=[world.name for world in WORLDS])
    parser.add_argument("--case", action="append", choices=[case.name for case in CASES])
    parser.add_argument("--queries", type=int, help="of each case, in place of the full suite's numbers")
    parser.add_argument("--processes", type=int, default=os.cpu_count(), help="worlds at a time")
    parser.add_argument("--anew", action="store_true", help="also what this program has measured so before")
    parser.add_argument("--report", action="store_true", help="measure nothing: report the parts there are")
    arguments = parser.parse_args(argv)
    everywhere = [world for world in WORLDS if not world.large]
    worlds = [world for world in WORLDS if world.name in (arguments.world or [w.name for w in everywhere])]
    cases = [case for case in CASES if arguments.case is None or case.name in arguments.case]
    count = arguments.queries
    sizes = FULL if count is None else Sizes(count, count, count)
    if not arguments.report:
        resume = not arguments.anew
        measure_in_processes(worlds, cases, sizes, WORK, everywhere, arguments.processes, resume)
    summarize(WORLDS, WORK)
    print((WORK / "report.md").read_text())

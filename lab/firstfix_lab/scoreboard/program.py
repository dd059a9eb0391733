"""Measures the present commit: ``firstfix-lab scoreboard [SUITE ...] [--quick]``.

Suites whose result is of the present code are left out, so that a run can be gone on with. Then
``python scripts/generate.py`` makes the pages anew. ``--check`` measures nothing, and lists what is older
than the code.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from firstfix_lab.checkout import ROOT

from ..figures import OPTIONS
from .check import check
from .run import NotOneCommit, run
from .suites import SUITES

RESULTS = ROOT / "lab" / "results"
QUICK_RESULTS = ROOT / "build" / "bench" / "scoreboard"


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab scoreboard", description="Measures the present commit."
    )
    parser.add_argument("suites", nargs="*", metavar="SUITE", help=f"some of {', '.join(SUITES)}; none: all")
    parser.add_argument(
        "--quick", action="store_true", help="small versions, of the work tree as it is; no page shows them"
    )
    parser.add_argument(
        "--sets", metavar="NAMES", help=f"{', '.join(OPTIONS['sets'])}: some of the data sets"
    )
    parser.add_argument(
        "--changes", metavar="NAMES", help=f"{', '.join(OPTIONS['changes'])}: some of the changes"
    )
    parser.add_argument("--results", type=Path, metavar="DIR", help="instead of lab/results")
    parser.add_argument(
        "--check",
        action="store_true",
        help="measure nothing, and list the results that are older than the code",
    )
    arguments = parser.parse_args(argv)
    if unknown := set(arguments.suites) - set(SUITES):
        parser.error(f"not among {', '.join(SUITES)}: {', '.join(sorted(unknown))}")
    results = arguments.results or (QUICK_RESULTS if arguments.quick else RESULTS)
    suites = [SUITES[name] for name in arguments.suites or SUITES]
    for option in ("sets", "changes"):
        if (names := getattr(arguments, option)) is None:
            continue
        if without := [suite.name for suite in suites if suite.name not in OPTIONS[option]]:
            parser.error(f"--{option} belongs to {', '.join(OPTIONS[option])}, not to {', '.join(without)}")
        suites = [replace(suite, arguments=(*suite.arguments, f"--{option}", names)) for suite in suites]
    if arguments.check:
        print(*check(suites, ROOT, results), sep="\n")
        return
    try:
        told = run(suites, ROOT, results, quick=arguments.quick, say=lambda line: print(line, flush=True))
    except NotOneCommit as error:
        sys.exit(f"scoreboard: {error}")
    if any(line.startswith("failed: ") for line in told.values()):
        sys.exit(1)

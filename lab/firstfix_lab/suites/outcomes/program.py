"""``firstfix-lab outcomes``: see ``suite``."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from firstfix_builder.self_test import strangers, taught_outcomes

from .figures import figures_of, told
from .strangers import write_strangers
from .suite import WORK, available, measure, processes, write_table


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(
        prog="firstfix-lab outcomes", description="What many maps teach every build."
    )
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("strangers", help="make the scans of strange places anew")
    table = commands.add_parser("table", help="ask all maps, and make the table anew")
    table.add_argument("--work", type=Path, default=WORK, metavar="DIR", help="versions are kept here")
    table.add_argument("--map", action="append", metavar="NAME", help="ask these alone")
    commands.add_parser("show", help="what the table shows, each map judged by the others")
    arguments = parser.parse_args(argv)
    if arguments.command == "strangers":
        print(f"{write_strangers(strangers.PATH)} scans in {strangers.PATH.name}")
    elif arguments.command == "table":
        measure(arguments.map or available(), arguments.work, processes())
        count = write_table(arguments.work, taught_outcomes.PATH)
        print(f"{count} answers in {taught_outcomes.PATH.name}")
    else:
        print(told(figures_of(taught_outcomes.taught_outcomes())))

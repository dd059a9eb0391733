"""Runs an evaluation suite: ``firstfix-lab SUITE [--quick] [--json FILE]``.

Some suites take more options, see ``OPTIONS``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from tests.recorded_data import DATASETS

from .drills.hostile import suite as hostile
from .suites.ablation import suite as ablation
from .suites.beside import suite as beside
from .suites.calibration import suite as calibration
from .suites.paper import suite as paper
from .suites.peers import suite as peers
from .suites.real import suite as real
from .suites.rebuilds import suite as rebuilds
from .suites.robust import suite as robust
from .suites.scale import suite as scale
from .suites.service import suite as service

SUITES = {
    "ablation": ablation.run,
    "beside": beside.run,
    "calibration": calibration.run,
    "hostile": hostile.run,
    "paper": paper.run,
    "peers": peers.run,
    "real": real.run,
    "rebuilds": rebuilds.run,
    "robust": robust.run,
    "scale": scale.run,
    "service": service.run,
}
OPTIONS = {
    "attacks": ("hostile",),
    "beside": ("beside",),
    "parts": ("beside",),
    "sets": ("ablation", "real", "peers"),
    "scans": ("peers",),
    "bbs": ("peers",),
    "changes": ("rebuilds",),
}


def _names(known: tuple[str, ...], text: str) -> tuple[str, ...]:
    names = tuple(text.split(","))
    if unknown := set(names) - set(known):
        raise argparse.ArgumentTypeError(f"not among {', '.join(known)}: {', '.join(sorted(unknown))}")
    return names


def _parts(text: str) -> tuple[str, ...]:
    return _names(tuple(beside.PARTS), text)


def _attacks(text: str) -> tuple[str, ...]:
    return _names(tuple(hostile.ATTACKS), text)


def _sets(text: str) -> tuple[str, ...]:
    return _names(tuple(dataset.name for dataset in DATASETS), text)


def _changes(text: str) -> tuple[str, ...]:
    return _names(tuple(rebuilds.CHANGES), text)


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, not {text}")
    return int(text)


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(prog="firstfix-lab", description="Runs an evaluation suite.")
    parser.add_argument("suite", choices=sorted(SUITES))
    parser.add_argument("--quick", action="store_true", help="a smaller version")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    parser.add_argument("--beside", type=Path, metavar="DIR", help="beside: another checkout, asked in turns")
    parser.add_argument(
        "--parts", type=_parts, metavar="NAMES", help=f"beside: some of {','.join(beside.PARTS)}"
    )
    parser.add_argument("--attacks", type=_attacks, metavar="NAMES", help="hostile: some of the attacks")
    parser.add_argument(
        "--sets", type=_sets, metavar="NAMES", help="ablation, real, peers: some of the data sets"
    )
    parser.add_argument("--scans", type=_count, metavar="N", help="peers: queries of each set")
    parser.add_argument("--bbs", type=Path, metavar="PREFIX", help="peers: where 3D-BBS is installed")
    parser.add_argument(
        "--changes", type=_changes, metavar="NAMES", help=f"rebuilds: some of {','.join(rebuilds.CHANGES)}"
    )
    arguments = parser.parse_args(argv)
    given = {name: getattr(arguments, name) for name in OPTIONS if getattr(arguments, name) is not None}
    for name in given:
        if arguments.suite not in OPTIONS[name]:
            parser.error(f"--{name} belongs to {' and '.join(OPTIONS[name])}, not to {arguments.suite}")
    text = json.dumps(SUITES[arguments.suite](arguments.quick, **given), indent=1)
    print(text)
    if arguments.json:
        arguments.json.write_text(text + "\n")

"""Scans of strange places, which ship with the release: no map has them, so each place found is wrong."""

from __future__ import annotations

import zipfile
from functools import cache
from pathlib import Path

import numpy as np

from firstfix.scan.compact import CompactScan
from firstfix.wire.query import decode_query

# Made by `firstfix-lab outcomes strangers`: factories, offices, a campus and a farm, seen by six
# sensors.
PATH = Path(__file__).parent / "taught" / "strangers.zip"


def drawn_strangers(count: int, rng: np.random.Generator) -> list[CompactScan]:
    """``count`` of the scans by chance, or all where there are fewer."""
    every = strangers()
    return [every[row] for row in sorted(rng.permutation(len(every))[:count].tolist())]


@cache
def strangers() -> tuple[CompactScan, ...]:
    """All of them, in the order of the archive: the places of one kind stand apart."""
    with zipfile.ZipFile(PATH) as archive:
        scans = [decode_query(archive.read(name)) for name in archive.namelist()]
    return tuple(scan for scan in scans if isinstance(scan, CompactScan))

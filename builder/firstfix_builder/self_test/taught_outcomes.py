"""Lessons of many maps: outcomes of natural scans in maps of known truth, which ship with the release.

A map's own self-test has some two hundred cases, and the most probable of its wrong ones says little: the
next map's will have another. Thousands of scans in many maps show how probable natural wrong answers get at
all.
"""

from __future__ import annotations

import csv
import gzip
import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from firstfix.engine.false_accept_bound import THRESHOLDS, upper_bound

from .threshold import ABSENT_SHARE, STEPS, Ceiling, Judged

# Made by `firstfix-lab outcomes table`.
PATH = Path(__file__).parent / "taught" / "outcomes.csv.gz"
COLUMNS = ("map", "place", "sensor", "own_threshold", "kind", "claimed", "right")
HERE, ELSEWHERE, ALIKE = "here", "elsewhere", "alike"
# No ceiling is lower, whatever natural scans show: of scans whose true place was taken away, 2 % are accepted
# from here on, and 7 % from 0.9 on (lab/docs/experiments.md, "The threshold").
MIN_CEILING = 0.99


@dataclass(frozen=True)
class TaughtOutcome:
    """One answer to a natural scan: a real one, or one that is not disturbed as the self-test's are.

    Attributes:
        map: name of the map that was asked.
        place: maps of one place have the same.
        own_threshold: that the map's own self-test shows.
        kind: HERE: a scan of the map; ELSEWHERE: of another place; ALIKE: of another building of the same
            kind, which no threshold keeps out for sure.
        case: with the probability that the map's own calibration gave it.
    """

    map: str
    place: str
    sensor: str
    own_threshold: float
    kind: str
    case: Judged


@dataclass(frozen=True)
class TaughtOutcomes:
    """Outcomes of many maps.

    Attributes:
        version: digest of the table, for the manifest.
    """

    rows: tuple[TaughtOutcome, ...]
    version: str

    def ceiling(self, max_false_accept: float, *, but_of: str | None = None) -> Ceiling | None:
        """The ceiling that keeps a promise; None if no threshold does.

        Scans of look-alikes do not count: what is missing from a map is not known to it.

        Args:
            max_false_accept: largest share of the answers ``localized`` that may be wrong.
            but_of: place whose maps do not count; None: all count.
        """
        rows = [row for row in self.rows if row.place != but_of]
        here = [row.case for row in rows if row.kind == HERE]
        elsewhere = [row.case.claimed for row in rows if row.kind == ELSEWHERE]
        for threshold in THRESHOLDS:
            if threshold >= MIN_CEILING:
                bound = _wrong_at_most(here, elsewhere, threshold)
                if bound <= max_false_accept:
                    return Ceiling(threshold, bound)
        return None

    def to_mapping(self) -> dict[str, Any]:
        """The record of the table for the manifest."""
        return {
            "version": self.version,
            "maps": len({row.map for row in self.rows}),
            "answers": len(self.rows),
        }


@cache
def taught_outcomes() -> TaughtOutcomes:
    """The table of this release."""
    data = PATH.read_bytes()
    return TaughtOutcomes(
        tuple(_outcome(row) for row in csv.DictReader(gzip.decompress(data).decode().splitlines())),
        hashlib.sha256(data).hexdigest()[:12],
    )


def _outcome(row: dict[str, str]) -> TaughtOutcome:
    case = Judged(float(row["claimed"]), row["right"] == "1", row["kind"] == HERE)
    return TaughtOutcome(
        row["map"], row["place"], row["sensor"], float(row["own_threshold"]), row["kind"], case
    )


def _wrong_at_most(here: Sequence[Judged], elsewhere: Sequence[float], threshold: float) -> float:
    """Upper bound of the wrong share of the answers ``localized`` (docs/method.md equation 11.3)."""
    accepted = [case.right for case in here if case.claimed >= threshold]
    strange = sum(claimed >= threshold for claimed in elsewhere)
    if not accepted or not elsewhere:
        return 1.0
    localized = (1 - ABSENT_SHARE) * len(accepted) / len(here)
    wrong = localized * upper_bound(len(accepted) - sum(accepted), len(accepted))
    false = ABSENT_SHARE * upper_bound(strange, len(elsewhere))
    return math.ceil((wrong + false) / (localized + false) * STEPS) / STEPS

"""The end of the self-test: more queries would hardly change what it decides.

Queries are asked in rounds, in an order that chance draws beforehand. From FIRST_LOOK on, each round's end is
a look at what is still open (docs/method.md section 11). Nothing else ends the test, so equal inputs end it
at the same query.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from firstfix.builds.config import ActivateConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import upper_bound

from .outcome import Outcome

ROUNDS, FIRST_LOOK = 6, 3
FOUND, THRESHOLD, TIES, PLACES = "found", "threshold", "ties", "places"  # what may be open
OF_THE_MAP = frozenset({TIES, PLACES})  # only scans of the map tell, and no prior does
DECIDED, ALL_ASKED = "decided", "all asked"
_STEADY = 0.02  # of support: widths of ties that the last rounds moved by no more are known
_SURE = 0.99  # confidence in the bounds of the share found
_SILENT = 0.2  # share of the scans that are not localized, from which on they tell of weak places


@dataclass(frozen=True)
class Ended:
    """The end of a self-test.

    Attributes:
        planned: number of queries, those in the map and those of strange places.
        share: of them, 0..1, that was asked.
        still_open: at the last look at which the test went on: FOUND, THRESHOLD, TIES, PLACES.
        is_decided: whether it ended because nothing was open; else all scans of the map were asked.
    """

    planned: int
    share: float
    still_open: tuple[str, ...]
    is_decided: bool

    def to_mapping(self) -> dict[str, Any]:
        """Values by name, ready for JSON."""
        return {
            "planned": self.planned,
            "share": round(self.share, 4),
            "ended": DECIDED if self.is_decided else ALL_ASKED,
            "still_open": list(self.still_open),
        }


def are_steady(widths: Sequence[tuple[float, float]]) -> bool:
    """Whether the widths of ties are known: no round but the first ones moved them.

    Args:
        widths: that the scans until the end of each round teach (``lesson.tie_widths``).
    """
    of_kind = zip(*widths[-FIRST_LOOK:], strict=True)
    return all(max(several) - min(several) <= _STEADY for several in of_kind)


def still_open(
    inside: Sequence[Outcome],
    calibration: Calibration,
    activate: ActivateConfig,
    *,
    is_threshold_settled: bool,
    are_ties_settled: bool,
) -> tuple[str, ...]:
    """Name what more queries may decide otherwise.

    A map that is held back anyway has no weak places and no ties to look for.

    Args:
        inside: outcomes of simulated scans in the map.
        calibration: that they teach.
    """
    found, count = sum(one.found_by(calibration) for one in inside), len(inside)
    at_most, at_least = upper_bound(found, count, _SURE), 1 - upper_bound(count - found, count, _SURE)
    is_bad = at_most < activate.min_found
    is_good = at_least >= max(activate.min_found, found / max(1, count) - activate.max_loss)
    opened = {FOUND: not (is_bad or is_good), THRESHOLD: not is_threshold_settled}
    if not is_bad:
        silent = count - sum(one.accepted_by(calibration) for one in inside)
        opened |= {TIES: not are_ties_settled, PLACES: silent >= _SILENT * count}
    return tuple(name for name, is_open in opened.items() if is_open)

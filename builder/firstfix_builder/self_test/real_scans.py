"""Real scans in the self-test: which of them fit the map, how much they weigh, and what they show."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.answer.options import LocalizeOptions
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.transform import transform_points

from ..sources.read_map.held_out import HeldOut, HeldOutScan
from ..sources.read_map.held_out_parts import HeldOutParts
from .reliability import FOLDS

MAX_RESIDUAL_M = 0.3  # median distance of a scan's points from the map: beyond it, its pose does not fit
COMPARED_POINTS = 2000
MAX_WEIGHT = 1.0  # of a real scan, against a simulated one: more told held-out real scans nothing better
UNLIKELY = 0.05  # so rarely do equal rates give such counts: the real and the simulated scans disagree
COMPARED = ("1m", "localized")


@dataclass(frozen=True)
class RealScans:
    """The real scans that the self-test asks.

    Attributes:
        scans: with T_level_sensor; held-out ones first, then confirmed ones.
        left_out: reasons against all others, by name.
        of_map: ``HeldOut.of_map``.
    """

    scans: tuple[HeldOutScan, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)
    of_map: HeldOutParts | None = None

    @classmethod
    def of(
        cls, held_out: HeldOut, map_points: NDArray[np.floating], confirmed: HeldOut | None = None
    ) -> RealScans:
        """Select the scans whose poses fit the map.

        Args:
            held_out: by the map's source, with poses in the level frame.
            map_points: (n, 3) in the same frame.
            confirmed: by robots' queries, in the same frame.
        """
        confirmed = confirmed or HeldOut()
        scans, left_out = (*held_out.scans, *confirmed.scans), {**held_out.reasons, **confirmed.reasons}
        if not scans:
            return cls((), left_out, held_out.of_map)
        tree, fit = cKDTree(map_points), []
        for one in scans:
            points = one.scan.points[rows_by_chance(len(one.scan.points), COMPARED_POINTS)]
            away_m = tree.query(transform_points(one.T_sensor, points))[0]
            residual_m = float(np.median(away_m)) if len(away_m) else np.inf
            if residual_m <= MAX_RESIDUAL_M:
                fit.append(one)
            else:
                left_out[one.name] = (
                    f"its pose does not fit the map: half of its points are over {residual_m:.2f} m away "
                    f"(limit {MAX_RESIDUAL_M} m)"
                )
        return cls(tuple(fit), left_out, held_out.of_map)

    def options_of(self, number: int, usual: LocalizeOptions) -> LocalizeOptions:
        """Options that a scan is asked with: a robot's query with its own, others as usual."""
        told = self.scans[number].confirmation
        return usual if told is None else LocalizeOptions.from_strings(told.options)

    def parts(self) -> dict[str, Any] | None:
        """``HeldOutParts`` as JSON values; None: the map is not made of scans, or none should be held out."""
        return None if self.of_map is None else self.of_map.to_mapping()

    def confirmations(self) -> dict[str, Any]:
        """How many of the scans are confirmed queries, of how many robots, told by how many, and when."""
        told = [one.confirmation for one in self.scans if one.confirmation is not None]
        at = sorted(one.told_at for one in told if one.told_at)
        return {
            "asked": len(told),
            "robots": len({one.robot for one in told}),
            "told_by": len({one.told_by for one in told}),
            "told_from": at[0] if at else None,
            "told_to": at[-1] if at else None,
        }

    def weight(self, simulated: int) -> float:
        """Weight of each, a simulated one has 1. Together they weigh no more than the simulated ones."""
        return min(MAX_WEIGHT, simulated / max(1, len(self.scans))) if simulated else 1.0

    def query(self, number: int, first: int) -> int:
        """Number of a scan's query: neighbours are on one side of a fold, because they look alike.

        Args:
            number: of the scan.
            first: the first number that is free.
        """
        fold = number * FOLDS // len(self.scans)
        return FOLDS * (first // FOLDS + 1 + number) + fold


def disagreeing(
    real: Mapping[str, float], simulated: Mapping[str, float], scans: tuple[int, int]
) -> list[str]:
    """Which of COMPARED differ by more than chance (Fisher's exact test of the counts).

    Args:
        scans: numbers of real and of simulated scans.
    """
    if not all(scans):
        return []
    return [name for name in COMPARED if _differ((real[name], simulated[name]), scans)]


def _differ(shares: Sequence[float], scans: tuple[int, int]) -> bool:
    from scipy.stats import fisher_exact  # imported late: half of the start of each process of a build

    yes = [round(share * count) for share, count in zip(shares, scans, strict=True)]
    table: Any = [yes, [count - good for count, good in zip(scans, yes, strict=True)]]
    return float(fisher_exact(table).pvalue) < UNLIKELY

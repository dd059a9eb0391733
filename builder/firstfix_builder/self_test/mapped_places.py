"""Places of the map that the mapping run saw in part: through a door, or from afar."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.index import MapIndex
from firstfix.sensor import SensorModel

from ..index.carve import poses_needed
from ..simulation.simulate import Simulator
from .localizability import DRIVE_THROUGH, cells_of
from .never_seen import never_seen

# Of the space. In a mapped office 1 of 113 scans above it was localized, and half of the 367 below. On a
# street driven through once, its side streets are above: 77 % of the scans localized there, 94 % elsewhere.
IN_PART = 0.25
TEMPLATES = 4  # of each cell
MAX_TOLD = 200  # cells without scans: a manifest stays small
_SEED = 0


@dataclass(frozen=True)
class MappedPlaces:
    """How much of each place the mapping run never saw.

    Attributes:
        never_seen: share of the space around the templates, 0..1, by cell of the localizability grid. Storeys
            one above another share a cell, as they do there.
    """

    never_seen: Mapping[tuple[int, int], float]

    @classmethod
    def of(
        cls,
        index: MapIndex,
        trajectory: NDArray[np.float64] | None,
        simulator: Simulator,
        sensor: SensorModel,
    ) -> MappedPlaces | None:
        """The places of an index, each by some of its templates.

        Args:
            trajectory: (m, 4, 4) poses of the mapping run in the level frame, or None.

        Returns:
            None: not known. The map has no trajectory, or stations so sparse that what lies between their
            rays would count as never seen.
        """
        if trajectory is None or index.seen_free is None or poses_needed(trajectory) == 1:
            return None
        positions_m = index.cascade.templates.position_m
        shuffled = np.random.default_rng(_SEED).permutation(len(positions_m))
        chosen: dict[tuple[int, int], list[int]] = {}
        for row, cell in zip(shuffled.tolist(), cells_of(positions_m[shuffled]), strict=True):
            here = chosen.setdefault(cell, [])
            if len(here) < TEMPLATES:
                here.append(row)
        rows = [row for cell in sorted(chosen) for row in chosen[cell]]
        shares = dict(
            zip(rows, never_seen(index.seen_free, simulator, sensor, positions_m[rows]), strict=True)
        )
        found = {}
        for cell in sorted(chosen):
            known = [shares[row] for row in chosen[cell] if np.isfinite(shares[row])]
            if known:
                found[cell] = round(float(np.mean(known)), 4)
        return cls(found)

    @property
    def in_part(self) -> list[tuple[int, int]]:
        """Cells that were mapped in part, those of which most was never seen first."""
        cells = (cell for cell, share in self.never_seen.items() if share > IN_PART)
        return sorted(cells, key=lambda cell: (-self.never_seen[cell], cell))

    def told_of(self, grid: Sequence[Mapping[str, Any]]) -> list[dict[str, object]]:
        """The cells of ``localizability.grid_of``, each with its share ``never_seen`` and ``in_part``.

        Driving through helps those in part that are known and not said.
        """
        told: list[dict[str, object]] = []
        for one in grid:
            share = self.never_seen.get((one["cell"][0], one["cell"][1]))
            known = {} if share is None else {"never_seen": share, "in_part": share > IN_PART}
            drive = {"helps": DRIVE_THROUGH} if "helps" in one and known.get("in_part") else {}
            told.append({**one, **known, **drive})
        return told

    def to_mapping(self, grid: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
        """The figures of all places, as JSON values.

        ``places`` and how many of them were mapped ``in_part``; shares of the grid's scans that were
        localized in these (``localized_in_part``) and in the others (``localized_elsewhere``), None without
        scans; and the cells mapped in part in which no scan was taken (``without_scans``).
        """
        in_part = self.in_part
        scanned = {(one["cell"][0], one["cell"][1]): one for one in grid}
        others = [
            one for cell, one in scanned.items() if cell in self.never_seen and cell not in set(in_part)
        ]
        without = [cell for cell in in_part if cell not in scanned]
        return {
            "places": len(self.never_seen),
            "in_part": len(in_part),
            "localized_in_part": _localized([scanned[cell] for cell in in_part if cell in scanned]),
            "localized_elsewhere": _localized(others),
            "without_scans": [
                {"cell": list(cell), "never_seen": self.never_seen[cell]} for cell in without[:MAX_TOLD]
            ],
        }


def _localized(cells: Sequence[Mapping[str, Any]]) -> float | None:
    scans = sum(one["scans"] for one in cells)
    return round(sum(one["localized"] for one in cells) / scans, 4) if scans else None

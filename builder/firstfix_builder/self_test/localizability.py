"""Map of localizability: where scans localize, where they do not, and which places they confuse."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ..index.top_view import TopView
from ..plot import BLUE, CROSS, GREEN, ORANGE, PURPLE, RED, SQUARE, Plot
from ..viewpoints.left_out_floor import SeenFloor

CELL_M = 4.0
_COLOURS = {"localized": GREEN, "unsure": ORANGE, "wrong": RED}
_FAINTER = 3  # the map, against what is drawn on it
# What helps where a place is known and not said.
SECOND_SCAN, PRIOR, OTHER_HEIGHT, DRIVE_THROUGH = "second_scan", "prior", "other_height", "drive_through"


@dataclass(frozen=True)
class QueriedPlace:
    """One scan of the self-test.

    Attributes:
        position_m: (3,) where it was taken, in the index's levelled frame.
        outcome: "localized" with a right pose; "unsure", no pose; or "wrong".
        rival_m: (3,) the most similar place elsewhere, or None.
        found: whether it is the best place of the answer, or ties with it.
    """

    position_m: NDArray[np.float64]
    outcome: str
    rival_m: NDArray[np.float64] | None
    found: bool


def grid_of(places: Sequence[QueriedPlace]) -> list[dict[str, object]]:
    """The cells of CELL_M in which scans were taken.

    Each has the number of its scans, of those that localized, of those that were wrong, of those whose place
    was found, and the cell that the unsure ones resembled most. A cell that is known and not said, as half of
    its places or more were found and fewer localized, has what ``helps``.
    Where the mapping run is known, ``MappedPlaces.told_of`` adds how much of the space there it never saw.
    Cells are counted from the frame's origin.
    """
    cells: dict[tuple[int, int], list[QueriedPlace]] = {}
    for place in places:
        cells.setdefault(_cell(place.position_m), []).append(place)
    grid: list[dict[str, object]] = []
    for cell, here in sorted(cells.items()):
        unsure = Counter(_cell(s.rival_m) for s in here if s.outcome != "localized" and s.rival_m is not None)
        taken_for = _most(unsure) if unsure else None
        localized = sum(place.outcome == "localized" for place in here)
        found = sum(place.found for place in here)
        is_silent = 2 * localized < len(here) <= 2 * found
        grid.append(
            {
                "cell": list(cell),
                "scans": len(here),
                "localized": localized,
                "wrong": sum(place.outcome == "wrong" for place in here),
                "found": found,
                "taken_for": None if taken_for is None else list(taken_for),
                **({"helps": _helps(cell, taken_for)} if is_silent else {}),
            }
        )
    return grid


def _helps(cell: tuple[int, int], taken_for: tuple[int, int] | None) -> str:
    """The remedy for a scan of a place that resembles another one, or none: then it sees too little."""
    if taken_for is None:
        return OTHER_HEIGHT
    return PRIOR if taken_for == cell else SECOND_SCAN  # above, below or beside it: a few metres tell nothing


def cells_of(positions_m: NDArray[np.floating]) -> list[tuple[int, int]]:
    """Cells of CELL_M in which (n, 3) positions of the index's levelled frame lie."""
    return [(x, y) for x, y in np.floor(positions_m[:, :2] / CELL_M).astype(int).tolist()]


def draw_localizability(
    map_points: NDArray[np.floating],
    places: Sequence[QueriedPlace],
    path: Path,
    floor: SeenFloor | None = None,
    in_part: Sequence[tuple[int, int]] = (),
    marked: Mapping[str, NDArray[np.float64]] = MappingProxyType({}),
) -> None:
    """Draw a PNG: each scan of the self-test by its outcome, and lines from unsure ones to similar places.

    Floor without templates is drawn below them, and cells that were mapped ``in_part`` are hatched. The
    (n, 3) places ``marked`` are those of the map's findings, by code, in the index's levelled frame.
    """
    view = TopView.of(map_points)
    plot = Plot(view.extent_m, view.pixel_m)
    plot.image(np.zeros(3), view.opacity / _FAINTER)
    if floor is not None and len(floor.left_out):
        label = f"no template: {floor.without_template:.0%} of the seen floor"
        plot.marks(floor.left_out, PURPLE, 1.7, shape=SQUARE, opacity=0.4, label=label)
    if in_part:
        plot.hatched(np.array(in_part) * CELL_M, CELL_M, BLUE, f"mapped in part: {len(in_part)} places")
    for place in places:
        if place.outcome != "localized" and place.rival_m is not None:
            plot.lines(place.position_m[None], place.rival_m[None], _COLOURS[place.outcome], 0.6)
    for outcome, colour in _COLOURS.items():
        at = np.array([place.position_m for place in places if place.outcome == outcome]).reshape(-1, 3)
        plot.marks(at, colour, 3.2, label=f"{outcome}: {len(at)}")
    for code, at in marked.items():
        plot.marks(at, PURPLE, 5, shape=CROSS, label=code)
    plot.save(path, x="x (m)", y="y (m)")


def _most(cells: Counter[tuple[int, int]]) -> tuple[int, int]:
    return min(cells, key=lambda cell: (-cells[cell], cell))


def _cell(position_m: NDArray[np.floating]) -> tuple[int, int]:
    (cell,) = cells_of(position_m[None])
    return cell

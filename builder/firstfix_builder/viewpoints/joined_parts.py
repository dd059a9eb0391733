"""The connected floors of a map from those of its tiles, and the ones that robots drive on."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .tile_floors import TileFloors
from .tiles import SHARED_TILES
from .traversable import connected_parts

COVERED = 0.8  # share of a storey that has something overhead
OVER_FLOOR = 0.5  # share of a roof that has a floor below it
WALLED = 0.4  # share of the rim of a storey without a ceiling; a roof falls away there, or has a parapet
COMPARABLE = 0.2  # of the main floor's area: a storey, and not a cupboard


class JoinedParts:
    """Joins the parts of tiles that are added in order, row by row of larger tiles.

    Of the borders of tiles it holds those of two rows at a time, and of each part six numbers.
    """

    def __init__(self) -> None:
        self._row: int | None = None
        self._borders: list[list[tuple[NDArray[np.int64], NDArray[np.int64]]]] = [
            [],
            [],
        ]  # the row before, this
        self._links: list[list[tuple[NDArray[np.int64], NDArray[np.int64]]]] = [[], []]
        self._pairs: list[NDArray[np.int64]] = []
        self._start = [0]
        self._area: list[NDArray[np.int64]] = []  # each (p, 5), as for ``_drivable``
        self._passed: list[NDArray[np.bool_]] = []

    def add(self, tile: tuple[int, int], floors: TileFloors) -> None:
        """Take the floors of the next tile."""
        row = tile[0] // SHARED_TILES
        if row != self._row:
            self._join()
            is_next = self._row is not None and row == self._row + 1
            self._borders = [self._borders[1] if is_next else [], []]
            self._links = [self._links[1] if is_next else [], []]
            self._row = row
        first = self._start[-1]
        self._borders[1].append((floors.border, floors.border_part + np.int64(first)))
        self._links[1].append((floors.link, floors.link_part + np.int64(first)))
        self._area.append(
            np.column_stack([floors.area, floors.covered, floors.above, floors.rim, floors.walled])
        )
        self._passed.append(floors.passed)
        self._start.append(first + len(floors.area))

    def parts_of(self, number: int) -> slice:
        """Places in ``chosen`` of the parts of the tile that was added as this number."""
        return slice(self._start[number], self._start[number + 1])

    def chosen(self, *, by_trajectory: bool) -> NDArray[np.bool_]:
        """(parts,) which parts of the tiles robots drive on, in the order in which they were added.

        Args:
            by_trajectory: those that are connected with a part that the trajectory passed over; otherwise
                the largest one that is no roof, and the other storeys of comparable size.
        """
        if self._start[-1] == 0:
            return np.zeros(0, np.bool_)
        part = self.floor_of
        chosen = np.zeros(int(part.max()) + 1, np.bool_)
        if by_trajectory:
            chosen[part[np.concatenate(self._passed)]] = True
        else:
            area = np.zeros((len(chosen), 5), np.int64)
            np.add.at(area, part, np.concatenate(self._area))
            chosen[_drivable(*area.T)] = True
        found: NDArray[np.bool_] = chosen[part]
        return found

    @cached_property
    def floor_of(self) -> NDArray[np.int64]:
        """(parts,) number of the connected floor that each part belongs to, when all have been added."""
        self._join()
        pairs = np.concatenate([np.zeros((0, 2), np.int64), *self._pairs])
        return connected_parts(pairs, self._start[-1])

    @property
    def cells(self) -> NDArray[np.int64]:
        """(parts,) cells of each part."""
        return np.concatenate([np.zeros((0, 5), np.int64), *self._area])[:, 0]

    def _join(self) -> None:
        """Join the parts of this row of tiles, and those with the row before."""
        border, of_border = _joined([*self._borders[0], *self._borders[1]])
        link, of_link = _joined([*self._links[0], *self._links[1]])
        order = np.argsort(border)
        place = np.searchsorted(border, link, sorter=order)
        place = order[np.minimum(place, len(order) - 1)] if len(order) else np.zeros(0, np.int64)
        link, of_link = link[: len(place)], of_link[: len(place)]
        met = border[place] == link
        self._pairs.append(np.unique(np.column_stack([of_link[met], of_border[place[met]]]), axis=0))


def _joined(
    columns: list[tuple[NDArray[np.int64], NDArray[np.int64]]],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    none = np.zeros(0, np.int64)
    return np.concatenate([none, *(a for a, _ in columns)]), np.concatenate([none, *(b for _, b in columns)])


def _drivable(
    area: NDArray[np.int64],
    covered: NDArray[np.int64],
    above: NDArray[np.int64],
    rim: NDArray[np.int64],
    walled: NDArray[np.int64],
) -> NDArray[np.int64]:
    """The largest part that is no roof, and the other storeys of comparable size.

    A storey has a ceiling, or walls where it ends: often a map ends below the ceiling, or was cut there.

    Args:
        area: (p,) cells of each connected part.
        covered: of them with something overhead.
        above: of them with another floor below, anywhere in the column.
        rim: sides of cells at which the part ends.
        walled: of them with a wall.
    """
    is_inside = (covered >= COVERED * area) | (walled >= WALLED * np.maximum(rim, 1))
    roof = (above / area > OVER_FLOOR) & ~is_inside
    main = int(np.argmax(np.where(roof.all() | ~roof, area, 0)))
    storey = is_inside & (area >= COMPARABLE * area[main])
    storey[main] = True
    return np.flatnonzero(storey)

"""A city of any extent, block by block: a block depends on the seed and on its own number alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.sensor import preset
from firstfix_cli.sample_world.place import Ground, Place
from firstfix_cli.sample_world.primitives import height_field

from .layout import BLOCK_M, BlockLayout

GROUND_STEP_M = 4.0
RELIEF_M = (6.0, 2.5, 0.8)  # height of the waves of the ground
RELIEF_LENGTH_M = (900.0, 370.0, 130.0)


@dataclass(frozen=True)
class City:
    """Blocks of houses, yards, parks and car parks in a grid of streets.

    Attributes:
        side: blocks along x and along y. The first has its corner at the map's zero.
        seed: another seed gives another city.
        rebuilt: numbers of blocks that other houses stand in, on the same ground.
    """

    side: int
    seed: int = 0
    rebuilt: frozenset[tuple[int, int]] = frozenset()

    @classmethod
    def of_extent(cls, extent_m: float, seed: int = 0) -> City:
        """The city of whole blocks that is nearest to an extent along x and y."""
        return cls(max(1, round(extent_m / BLOCK_M)), seed)

    def ground(self) -> Ground:
        """Height of the ground: waves, steepest 1 in 8."""
        rng = np.random.default_rng([self.seed, 1])
        waves = [
            (height / 2, 2 * np.pi / length, rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi))
            for height, length in zip(RELIEF_M, RELIEF_LENGTH_M, strict=True)
            for _ in range(2)
        ]

        def ground(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
            z = np.zeros(np.shape(x))
            for height, number, angle, phase in waves:
                z += height * np.sin(number * (np.cos(angle) * x + np.sin(angle) * y) + phase)
            return z

        return ground

    def block(self, column: int, row: int) -> Place:
        """The place of one block with half of the streets around it, in the city's frame.

        Its path goes round it in the middle of these streets.
        """
        again = [1] if (column, row) in self.rebuilt else []
        rng = np.random.default_rng([self.seed, 2, column, row, *again])
        middle = (np.array([column, row]) + 0.5) * BLOCK_M
        around = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]]) * BLOCK_M / 2
        path = np.column_stack([middle + around, np.zeros(len(around))])
        ground = self.ground()
        place = Place(preset("os1-64"), path, 0.2, stride_m=1.0, corner_m=1.5, ground=ground)
        axis = np.arange(-BLOCK_M / 2, BLOCK_M / 2 + GROUND_STEP_M / 2, GROUND_STEP_M)
        x, y = middle[0] + axis, middle[1] + axis
        gx, gy = np.meshgrid(x, y)
        place.fixed.append(height_field(x, y, ground(gx, gy)))
        BlockLayout(place, rng, *middle.tolist()).lay_out()
        return place

    def around(self, column: int, row: int, blocks: int) -> Place:
        """One block with its neighbours, so many to every side; its own path."""
        near = [
            (i, j)
            for i in range(max(0, column - blocks), min(self.side, column + blocks + 1))
            for j in range(max(0, row - blocks), min(self.side, row + blocks + 1))
        ]
        whole = self.block(column, row)
        for other in near:
            if other != (column, row):
                part = self.block(*other)
                whole.fixed += part.fixed
                whole.movables += part.movables
        return whole

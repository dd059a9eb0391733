"""The part of a map that a robot can see, with the directions to those who see it.

Where the map is a mesh this is what stands for its cloud. Not points spread over the surface: a modelled
wall has a back and a floor slab an underside, and a scan registered against those settles a wall's
thickness off. Where the map is a cloud it tells which face of a wall each of its points is on.

It is made block by block: in memory are a block and its neighbours' edges.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise, product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from firstfix.engine.made_of import Arrays, MadeOf, always
from firstfix.engine.registration.surface import Surface

from ..execution.local_executor import in_turn
from ..mesh.clean_cloud import voxel_means
from ..mesh.map_tiles import by_tiles
from .seen_voxels import BLOCK_M, SeenBlocks, mean_points
from .views import STEP_M

BORDER_M = 1.0  # of the neighbouring blocks, that normals at a border are taken from
SEEN_WITHIN_M = 0.3  # of a mapped point: the mesh is not the cloud

Block = tuple[int, int]


def map_surface(
    cloud: NDArray[np.floating] | None,
    views: Iterable[Arrays],
    voxel_m: float,
    scratch: Path | None = None,
    made_of: MadeOf = always,
) -> Surface:
    """The cloud of a map, or what is seen of a mesh, thinned and turned towards who sees it.

    Args:
        cloud: (n, 3), or None: the map is a mesh.
        views: results of ``views.view_chunks``, one of which is in memory at a time.
        scratch: folder for passing files.
        made_of: makes what is seen in a block and its normals, or takes those of an earlier build.
    """
    with TemporaryDirectory(dir=scratch) as folder:
        seen = SeenBlocks(Path(folder), STEP_M)
        for part in views:
            seen.add(part["voxels"])
        looked = _Blocks(Path(folder), "seen", sorted(seen.blocks))
        if cloud is None:
            looked.fill(lambda block: _seen(seen.voxels(block), voxel_m, made_of))
            points = looked
        else:
            looked.fill(lambda block: _seen(seen.voxels(block), 0.0, made_of))
            points = _turned_cloud(voxel_means(np.asarray(cloud, np.float64), voxel_m), looked, Path(folder))
        return points.whole_surface(made_of)


def _seen(voxels: NDArray[np.void], voxel_m: float, made_of: MadeOf) -> NDArray[np.float64]:
    """(m, 6) points and directions of the seen voxels of a block, thinned to voxel_m; 0: all."""

    def make() -> Arrays:
        means = mean_points(voxels, STEP_M)
        return {"points": voxel_means(means, voxel_m) if voxel_m else means}

    return made_of("seen", [voxels.view(np.uint8), np.array([STEP_M, voxel_m])], make)["points"]


def _turned_cloud(thin: NDArray[np.float64], looked: _Blocks, folder: Path) -> _Blocks:
    """Blocks of (n, 3) points of a cloud, each with the direction to those who saw the nearest seen point."""
    order, start = by_tiles(thin, BLOCK_M)
    rows = {_block_of(thin[order[a]]): order[a:b] for a, b in pairwise(start.tolist())}
    found = _Blocks(folder, "cloud", sorted(rows))

    def turned(block: Block) -> NDArray[np.float64]:
        own = thin[rows[block]]
        near = looked.around(block, SEEN_WITHIN_M)
        toward = np.zeros_like(own)
        if len(near):
            away_m, row = cKDTree(near[:, :3]).query(own, distance_upper_bound=SEEN_WITHIN_M)
            known = np.isfinite(away_m)
            toward[known] = near[row[known], 3:]
        return np.concatenate([own, toward], axis=1)

    found.fill(turned)
    return found


@dataclass(frozen=True)
class _Blocks:
    """(m, 6) points and directions of each block, in files.

    Attributes:
        name: of the files.
        blocks: that have any points.
    """

    folder: Path
    name: str
    blocks: list[Block]

    def fill(self, make: Callable[[Block], NDArray[np.float64]]) -> None:
        for block, points in in_turn(make, self.blocks):
            np.save(self._path(block), points)

    def whole_surface(self, made_of: MadeOf) -> Surface:
        """All blocks as a surface, one after the other."""
        count = sum(len(np.load(self._path(block), mmap_mode="r")) for block in self.blocks)
        parts = in_turn(lambda block: self._surface(block, made_of), self.blocks)
        return Surface.gathered((part for _, part in parts), count)

    def _surface(self, block: Block, made_of: MadeOf) -> Surface:
        """The block as a surface. Normals at its border are taken from the neighbours too."""
        own = self._load(block)
        both = np.concatenate([own, self._beside(block, BORDER_M)])

        def make() -> Arrays:
            found = Surface.around(both[:, :3], both[:, 3:], two_faces=True).at(slice(0, len(own)))
            return {"points": found.points, "normals": found.normals, "oriented": found.oriented}

        return Surface(**made_of("normals", [both, np.array(len(own))], make))

    def around(self, block: Block, border_m: float) -> NDArray[np.float64]:
        """The points of a block and of a border around it."""
        own = [self._load(block)] if self._path(block).exists() else []
        return np.concatenate([*own, self._beside(block, border_m)])

    def _beside(self, block: Block, border_m: float) -> NDArray[np.float64]:
        """The neighbours' points within the border."""
        low = np.array(block) * BLOCK_M - border_m
        high = low + BLOCK_M + 2 * border_m
        found = [np.zeros((0, 6))]
        for step in product((-1, 0, 1), repeat=2):
            path = self._path((block[0] + step[0], block[1] + step[1]))
            if any(step) and path.exists():
                points = np.load(path)
                x, y = points[:, 0], points[:, 1]
                found.append(points[(x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])])
        return np.concatenate(found)

    def _load(self, block: Block) -> NDArray[np.float64]:
        points: NDArray[np.float64] = np.load(self._path(block))
        return points

    def _path(self, block: Block) -> Path:
        return self.folder / f"{self.name}_{block[0]}_{block[1]}.npy"


def _block_of(point: NDArray[np.float64]) -> Block:
    x, y = np.floor(point[:2] / BLOCK_M).astype(int).tolist()
    return x, y

"""From the map cloud to a surface that rays can hit, in overlapping blocks of bounded size."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import ReconstructConfig
from firstfix.errors import BuildFailed

from ..execution.chunks import Arrays, Chunk
from ..execution.stage_cache import StageResult
from ..stage_files import TRAJECTORY_FILE
from .clean_cloud import surface_spacings_m
from .map_tiles import Block, occupied_blocks
from .mesh import Mesh
from .places.chance import SPACING_STEPS, stepped
from .places.tiled_points import TiledPoints
from .poisson import Tile, poisson_tile
from .signed_distance import Sampling, signed_distance_mesh

PLACE_STEP_M = 0.5
SIGHT_RANGE_M = 100.0  # a scanner further than this from a block was not what saw it
SIGHT_SPACINGS = 1.8
MAX_THIN = 0.1  # of an even cloud's points


@dataclass(frozen=True)
class MeshChunk(Chunk):
    """The surface of one block. Reads the points near it, and the poses, of the stage ``map``.

    Attributes:
        low, high: metres, the block.
        cell_m, spacing_m: of the finest cell, and between the cloud's points.
    """

    low: tuple[float, float]
    high: tuple[float, float]
    cell_m: float
    spacing_m: float
    config: ReconstructConfig

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """The block's vertices and triangles."""
        block = Block(np.array(self.low), np.array(self.high))
        points = TiledPoints.load(inputs["map"]).near(*self._reach)
        near = points[block.holds(points, self._margin_m)]
        mesh = self._surface(near, self._places(inputs["map"]), block)
        return {"vertices": mesh.vertices, "triangles": mesh.triangles}

    @property
    def _trim_m(self) -> float:
        return self.config.trimmed_spacings * self.spacing_m

    @abstractmethod
    def _surface(
        self, points: NDArray[np.float64], places: NDArray[np.float64] | None, block: Block
    ) -> Mesh: ...

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of the points and of the poses that the block depends on."""
        folder = inputs["map"].directory
        places = self._places(folder)
        return {
            "points": TiledPoints.load(folder).digest_near(*self._reach),
            "places": "none" if places is None else sha256(places.tobytes()).hexdigest(),
        }

    @property
    def _margin_m(self) -> float:
        return self.config.margin_cells * self.cell_m

    @property
    def _reach(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The (2,) corners of the block with its margin."""
        return np.array(self.low) - self._margin_m, np.array(self.high) + self._margin_m

    def _places(self, folder: Path) -> NDArray[np.float64] | None:
        """(m, 3) where the scanner was near the block; None: the map has no poses."""
        trajectory = folder / TRAJECTORY_FILE
        if not trajectory.exists():
            return None
        places = _thinned(np.load(trajectory)[:, :3, 3])
        return places[Block(np.array(self.low), np.array(self.high)).holds(places, SIGHT_RANGE_M)]


@dataclass(frozen=True)
class SignedDistanceChunk(MeshChunk):
    """The surface of one block where the signed distance is zero.

    Attributes:
        sampling: of the cloud; None where no place is known.
    """

    sampling: Sampling | None

    def _surface(self, points: NDArray[np.float64], places: NDArray[np.float64] | None, block: Block) -> Mesh:
        return signed_distance_mesh(
            points,
            places,
            block,
            cell_m=self.cell_m,
            sampling=self.sampling,
            trim_m=self._trim_m,
            sight_voxel_m=SIGHT_SPACINGS * self.spacing_m,
        )


@dataclass(frozen=True)
class PoissonChunk(MeshChunk):
    """The surface of one block by Poisson. Open3D's keeps the interpreter lock."""

    keeps_interpreter: ClassVar[bool] = True

    def _surface(self, points: NDArray[np.float64], places: NDArray[np.float64] | None, block: Block) -> Mesh:
        return poisson_tile(
            Tile(
                points=points,
                places=places,
                low=block.low,
                high=block.high,
                cell_m=self.cell_m,
                point_weight=self.config.point_weight,
                trim_m=self._trim_m,
                normal_radius_m=self.config.normal_spacings * self.spacing_m,
                normal_neighbours=self.config.normal_neighbours,
                sight_voxel_m=SIGHT_SPACINGS * self.spacing_m,
            )
        )


def mesh_chunks(
    points: NDArray[np.float64], trajectory: NDArray[np.float64] | None, config: ReconstructConfig
) -> list[MeshChunk]:
    """The work for a cloud of (n, 3) cleaned points, block by block.

    Args:
        points: metres.
        trajectory: (m, 4, 4) poses of the scanner, or None.
        config: of the reconstruction.

    Raises:
        BuildFailed: too few points.
    """
    if len(points) < 100:
        raise BuildFailed(f"a map of {len(points)} points has no surface")
    spacings_m = surface_spacings_m(points)
    spacing_m = stepped(float(np.median(spacings_m)), SPACING_STEPS)
    sampling = None
    if trajectory is not None and len(trajectory):
        sampling = Sampling.of(points, spacings_m, _thinned(trajectory[:, :3, 3]))
    if config.surface == "auto":
        is_thin = spacings_m > config.spacings_per_cell * spacing_m
        known = sampling is not None or float(is_thin.mean()) <= MAX_THIN
        config = config.model_copy(update={"surface": "signed-distance" if known else "poisson"})
    cell_m = config.cell_m or config.spacings_per_cell * spacing_m
    chunks: list[MeshChunk] = []
    for block in occupied_blocks(points, config.cells_per_tile * cell_m):
        common = _pair(block.low), _pair(block.high), cell_m, spacing_m, config
        if config.surface == "poisson":
            chunks.append(PoissonChunk(*common))
        else:
            chunks.append(SignedDistanceChunk(*common, sampling))
    return chunks


def block_meshes(parts: Iterable[Arrays]) -> Iterator[Mesh]:
    """Yield the surface of each block, in their order."""
    return (Mesh(part["vertices"], part["triangles"]) for part in parts)


def _pair(corner: NDArray[np.float64]) -> tuple[float, float]:
    return float(corner[0]), float(corner[1])


def _thinned(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    """One position of every half metre: a scanner that stood still is no better evidence."""
    _, first = np.unique(np.floor(positions / PLACE_STEP_M), axis=0, return_index=True)
    return positions[np.sort(first)]

"""Perturbed scans that keys are learned from, as chunks: those of one tile of the map.

Each scan has a place that chance chose, and all chance at a place is of its coordinates. So a change of a map
leaves the scans elsewhere as they are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import PerturbConfig
from firstfix.descriptor import Described
from firstfix.engine.config import DescriptorConfig, PreprocessConfig
from firstfix.engine.preprocess import preprocess
from firstfix.scan.sequence import ScanSequence
from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays, Chunk
from ..execution.stage_cache import StageResult
from ..mesh.map_tiles import by_nested_tiles
from ..mesh.places.chance import chance_of, rows_by_rank
from ..mesh.places.surface_cells import surface_cells_of
from ..simulation.local_simulator import local_simulator
from ..simulation.perturb import ScanSimulation
from ..simulation.simulate import Simulator
from .views import SHARED_M

TILE_M = 32.0
MARGIN_M = 1.0  # that noise may move a return, in or out of what the preprocessing keeps


@dataclass(frozen=True)
class KeyScans:
    """Recipe of scans and of their descriptions.

    Attributes:
        spacing_m: between templates. A scan is taken within half of it of its place, along x and y.
        seed: of all chance.
    """

    sensor: SensorModel
    perturb: PerturbConfig
    spacing_m: float
    preprocess: PreprocessConfig
    descriptor: DescriptorConfig
    seed: int

    @property
    def reach_m(self) -> float:
        """Distance beyond which no return is kept."""
        return min(self.sensor.max_range_m, self.preprocess.max_range_m + MARGIN_M)

    def at(self, simulator: Simulator, places: NDArray[np.float32]) -> Arrays:
        """Scan at (n, 3) positions of templates, fewer where nothing is free.

        Returns:
            ``position_m`` (k, 3) of the scans, and their descriptions by the descriptor's names.
        """
        sensor = replace(self.sensor, max_range_m=self.reach_m)
        simulation, descriptor = ScanSimulation(simulator, sensor, self.perturb), self.descriptor.make()
        spots: list[NDArray[np.float64]] = []
        found: list[Described] = []
        for place, chance in zip(places, chance_of(places, self.seed).tolist(), strict=True):
            rng = np.random.default_rng((self.seed, chance))
            for case in simulation.cases(place[None], self.spacing_m, 1, rng):
                scan = ScanSequence.single(simulation.scan(case))
                prepared = preprocess(scan, None, self.preprocess, sensor.R_base_sensor)
                if prepared is not None:
                    spots.append(case.T_level_sensor[:3, 3])
                    found.append(prepared.scans[0].described_by(descriptor))
        if not found:
            return {"position_m": np.zeros((0, 3))}
        described = {name: np.concatenate([one[name] for one in found]) for name in descriptor.arrays}
        return {"position_m": np.array(spots), **described}


@dataclass(frozen=True)
class KeyScansChunk(Chunk):
    """The scans at some places of one tile. Reads the input ``mesh``.

    Attributes:
        tile: its number in x and y.
        places: (n, 3) positions of templates, in single precision.
    """

    tile: tuple[int, int]
    places: tuple[tuple[float, float, float], ...]
    scans: KeyScans

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """The arrays of ``KeyScans.at``."""
        low = np.floor((np.array(self.tile) + 0.5) * TILE_M / SHARED_M) * SHARED_M
        simulator = local_simulator(inputs["mesh"], low, low + SHARED_M, self._reach_m)
        return self.scans.at(simulator, np.array(self.places, np.float32))

    @property
    def values(self) -> dict[str, Any]:
        """Places, and how scans are made. The tile says where the places are."""
        models = {name: getattr(self.scans, name) for name in ("perturb", "preprocess", "descriptor")}
        plain = {"spacing_m": self.scans.spacing_m, "seed": self.scans.seed}
        return {"places": self.places, "sensor": asdict(self.scans.sensor), **models, **plain}

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hash of the surface that a scan can see from the tile."""
        low = np.array(self.tile) * TILE_M
        cells = surface_cells_of(inputs["mesh"].directory)
        return {"mesh": cells.digest_within(low, low + TILE_M, self._reach_m)}

    @property
    def _reach_m(self) -> float:
        return self.scans.reach_m + self.scans.spacing_m


def key_scan_chunks(positions: NDArray[np.floating], count: int, scans: KeyScans) -> list[KeyScansChunk]:
    """The chunks of up to ``count`` scans in a map with templates at (n, 3) positions."""
    places = np.asarray(positions[rows_by_rank(positions, count, scans.seed)], np.float32)
    order, start = by_nested_tiles(places, SHARED_M, TILE_M)
    chunks = []
    for first, last in pairwise(start.tolist()):
        at = places[order[first:last]]
        column, row = np.floor(at[0, :2].astype(np.float64) / TILE_M).astype(int).tolist()
        chunks.append(KeyScansChunk((column, row), tuple(map(tuple, at.tolist())), scans))
    return chunks

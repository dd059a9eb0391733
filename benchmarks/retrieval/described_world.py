"""A world with a version of its templates, and scans simulated in it: templates, and perturbed queries."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from firstfix.builds.config import PerturbConfig, SimulateConfig
from firstfix.descriptor import Described, Descriptor
from firstfix.engine.config import OccupancyConfig, PreprocessConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.preprocess import preprocess
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, transform_points, yaw_of
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator, upright
from firstfix_builder.templates.make import SCANS_AT_ONCE, scan_batch

Gravity = Literal["estimated", "given", "none"]
Descriptors = Mapping[str, Descriptor]
UPRIGHT = ((0.0, 0.0),)


@dataclass(frozen=True)
class Known:
    """Described templates.

    Attributes:
        position_m: (n, 3), map frame; their headings are zero.
        upright: how many of them, the first, stand upright.
    """

    position_m: NDArray[np.float64]
    described: Described
    upright: int


@dataclass(frozen=True)
class Asked:
    """Described scans.

    Attributes:
        number: (n,) of each among the scans it was made from: too sparse ones are left out.
        position_m: (n, 3) where they were taken, map frame.
        yaw_rad: (n,) true heading of their levelled frames.
    """

    number: NDArray[np.intp]
    position_m: NDArray[np.float64]
    yaw_rad: NDArray[np.float64]
    described: Described


@dataclass(frozen=True)
class DescribedWorld:
    """A simulated world, its templates' poses and the way to describe scans.

    Attributes:
        simulator: in the map frame.
        position_m, height_m: (n, 3) and (n,) of the templates' sensors, map frame and above the floor.
    """

    simulator: Simulator
    position_m: NDArray[np.float64]
    height_m: NDArray[np.float64]
    spacing_m: float
    descriptor: OccupancyConfig
    preprocess: PreprocessConfig

    @classmethod
    def of(cls, index: MapIndex, simulator: Simulator) -> DescribedWorld:
        templates, config = index.cascade.templates, index.config
        assert isinstance(config.descriptor, OccupancyConfig)
        return cls(
            simulator,
            transform_points(index.T_map_level, templates.position_m),
            np.asarray(templates.height_m, np.float64),
            config.spacing_m,
            config.descriptor,
            config.preprocess,
        )

    def known(
        self,
        sensor: SensorModel,
        descriptors: Descriptors,
        tilts_deg: Sequence[tuple[float, float]] = UPRIGHT,
    ) -> dict[str, Known]:
        """Templates at every viewpoint as the builder casts them, and again at each further roll and pitch.

        Args:
            tilts_deg: the first is upright.
        """
        sensor = sensor.coarser(SimulateConfig().max_rays)
        directions = sensor.directions()
        turns = Rotation.from_euler("xy", tilts_deg, degrees=True).as_matrix()
        jobs = [
            (turn, slice(start, start + SCANS_AT_ONCE))
            for turn in turns
            for start in range(0, len(self.position_m), SCANS_AT_ONCE)
        ]

        def described(job: tuple[NDArray[np.float64], slice]) -> dict[str, Described]:
            turn, here = job
            T = upright(self.position_m[here])
            T[:, :3, :3] = turn
            ranges = np.concatenate(list(self.simulator.ranges(T, sensor)))
            scans = scan_batch(ranges, directions, self.height_m[here])
            return {name: how.describe(scans) for name, how in descriptors.items()}

        with ThreadPoolExecutor(os.cpu_count()) as threads:
            parts = list(threads.map(described, jobs))
        at_m = np.tile(self.position_m, (len(turns), 1))
        return {
            name: Known(at_m, _joined([p[name] for p in parts]), len(self.position_m)) for name in descriptors
        }

    def scans(
        self, sensor: SensorModel, perturb: PerturbConfig, count: int, seed: Sequence[int]
    ) -> list[tuple[Scan, Matrix]]:
        """Perturbed ones between the templates, and T_map_sensor."""
        rng = np.random.default_rng(seed)
        return perturbed_scans(self.simulator, sensor, self.position_m, self.spacing_m, count, perturb, rng)

    def asked(
        self, scans: Sequence[tuple[Scan, Matrix]], descriptors: Descriptors, gravity: Gravity = "estimated"
    ) -> dict[str, Asked]:
        """The scans as a query describes them: cropped, levelled, put on their floor."""

        def described(case: tuple[Scan, Matrix]) -> tuple[float, dict[str, Described]] | None:
            scan, T_map_sensor = case
            down = {
                "estimated": None,
                "given": -T_map_sensor[2, :3],
                "none": np.array([0.0, 0.0, -1.0]),
            }[gravity]
            prepared = preprocess(ScanSequence.single(scan), down, self.preprocess)
            if prepared is None:
                return None
            one = prepared.scans[0]
            yaw = yaw_of(T_map_sensor[:3, :3] @ one.R_level_sensor.T)
            return yaw, {name: how.describe(one.batch) for name, how in descriptors.items()}

        with ThreadPoolExecutor(os.cpu_count()) as threads:
            made = list(threads.map(described, scans))
        usable = [(number, *one) for number, one in enumerate(made) if one is not None]
        number = np.array([number for number, _, _ in usable], np.intp)
        at_m = np.array([T[:3, 3] for _, T in scans])[number]
        yaw = np.array([yaw for _, yaw, _ in usable])
        return {
            name: Asked(number, at_m, yaw, _joined([d[name] for _, _, d in usable])) for name in descriptors
        }


def _joined(parts: Sequence[Described]) -> Described:
    return {array: np.concatenate([part[array] for part in parts]) for array in parts[0]}

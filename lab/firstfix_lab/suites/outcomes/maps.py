"""The maps that teach: simulated worlds that no other suite measures in, the shared meshes, and real maps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import Matrix, inverse, make_transform, rotation_z, transform_points
from firstfix_cli.poses_csv import read_poses_csv
from tests.recorded_data import GARAGE, HALL, STREET, STREET_128, TURNING, YARD, Dataset

from ...common.worlds import BenchWorld, own_world, shared_world

_SPARSE = {"viewpoints": {"spacing_m": 1.0}}  # a quicker build
YAWS_DEG = (0.0, 120.0, 240.0)  # of the sensor on its robot, for each real scan


@dataclass(frozen=True)
class TaughtMap:
    """One map that teaches: of a simulated world, or a real one.

    Attributes:
        place: maps of one place have the same: what one teaches is not held out from the other.
    """

    name: str
    place: str
    world: BenchWorld | None = None
    real: Dataset | None = None

    @property
    def config(self) -> dict[str, Any]:
        """Config of the build."""
        return self._source.config

    @property
    def missing(self) -> str | None:
        """Why there is nothing; None: all is there."""
        if self.world is not None:
            return self.world.missing
        assert self.real is not None
        return None if self.real.available else f"{self.name} is not beside the checkout"

    @property
    def _source(self) -> BenchWorld | Dataset:
        source = self.world or self.real
        assert source is not None
        return source


def _of_world(world: BenchWorld) -> TaughtMap:
    return TaughtMap(world.name, world.place, world)


def _own(kind: str, seed: int, *, mapped: bool, sensor: str | None = None) -> TaughtMap:
    world = own_world(kind, mapped=mapped, seed=seed, look_alike_seed=seed + 100)
    name = f"{kind}_{seed}"
    config = world.config | _SPARSE | ({} if sensor is None else {"sensor": sensor})
    return _of_world(replace(world, name=name, place=name, config=config))


def _of_real(dataset: Dataset) -> TaughtMap:
    return TaughtMap(dataset.name, dataset.name, real=dataset)


MAPS = (
    _of_world(shared_world("warehouse_aws_small")),
    _of_world(shared_world("hospital_aws_1floor", **_SPARSE)),
    _of_world(shared_world("office_willow_garage", sensor="hdl-32e", **_SPARSE)),
    _of_world(shared_world("office_clearpath", changed="office_construction_clearpath")),
    _of_world(shared_world("inspection_clearpath", sensor="vlp-16", **_SPARSE)),
    _own("factory", 11, mapped=True),
    _own("factory", 12, mapped=False, sensor="mid-360"),
    _own("factory", 13, mapped=True, sensor="vlp-16"),
    _own("office", 11, mapped=False),
    _own("office", 12, mapped=True),
    _own("office", 13, mapped=True, sensor="xt32"),
    _own("office", 14, mapped=False, sensor="mid-360"),
    _own("campus", 11, mapped=False),
    _own("campus", 12, mapped=True, sensor="hdl-32e"),
    _own("farm", 11, mapped=False),
    _own("farm", 12, mapped=True, sensor="xt32"),
    *(_of_real(one) for one in (HALL, STREET, YARD, STREET_128, GARAGE, TURNING)),
)


def real_scans(dataset: Dataset, work: Path) -> list[tuple[Scan, Matrix]]:
    """The held-out scans of a real place, each as if its sensor were turned by YAWS_DEG, with T_map_sensor.

    Args:
        work: an existing folder.
    """
    found = []
    for row in read_poses_csv(dataset.write_queries(work / "truth.csv")):
        scan = read_scan_file(row.path)
        for yaw_deg in YAWS_DEG:
            T_sensor_turned = make_transform(rotation_z(np.radians(yaw_deg)), np.zeros(3))
            points = transform_points(inverse(T_sensor_turned), scan.points).astype(np.float32)
            found.append((replace(scan, points=points), row.T_map_sensor @ T_sensor_turned))
    return found

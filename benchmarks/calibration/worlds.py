"""The worlds that the prior is fitted to: places, maps of them, and the same places on another day.

Of the worlds of the robust suite, the project's own have other seeds here, and so other layouts. Some maps
are meshes of everything. Others are the clouds of a simulated mapping run, which missed surfaces: there the
world has more than the map. On another day some things have left: then it has less. Scans of a world with
another seed are of a building of the same kind that is not in the map.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.engine.index import MapIndex
from firstfix.engine.ranking import Calibration
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.pipeline import build_version
from firstfix_builder.simulation.worlds import NAMES, make_world
from firstfix_builder.simulation.worlds.write_world import ply_of_mesh, write_world

from ..common.datasets import SHARED
from ..common.worlds import Scenery, layout, write_drive

LOOK_ALIKE_SEED = 100  # is added to a world's own for its look-alike
_UNTESTED = {"self_test": {"queries": 0, "outside": 0}, "viewpoints": {"spacing_m": 1.0}}


@dataclass(frozen=True)
class MappedWorld:
    """A map, and the sceneries in which scans of it are taken.

    Attributes:
        source: what the version is built from, a mesh or a cloud.
        trajectory: of the mapping run, or None.
        sceneries: by name, in the frame of the source.
        look_alike: another place of the same kind, or None.
    """

    source: Path
    trajectory: Path | None
    sceneries: dict[str, Scenery]
    look_alike: Scenery | None = None


@dataclass(frozen=True)
class FittedWorld:
    """A world that the prior is fitted to.

    Attributes:
        place: worlds of one place are left out together when the prior is checked.
        sensor: preset of the templates and of the scans.
        make: writes into a folder what is not there yet.
        missing: why there is nothing, or None.
    """

    name: str
    place: str
    sensor: str
    make: Callable[[Path], MappedWorld]
    missing: str | None = None

    def index(self, folder: Path) -> MapIndex:
        """The built version with the prior as its calibration. It is built unless the folder holds it.

        A version stays until its folder is removed, also when the code has changed.
        """
        version = folder / "build" / "version"
        if not (version / "manifest.json").exists():
            mapped, config = self.make(folder), BuildConfig.parse({"sensor": self.sensor} | _UNTESTED)
            build_version(mapped.source, config, folder / "build", trajectory=mapped.trajectory)
        return MapIndex.load(version, Calibration())


def _shared(name: str, changed: str | None = None) -> FittedWorld:
    mesh, other_day = (SHARED / "worlds" / f"{one}.ply" for one in (name, changed or name))

    def make(folder: Path) -> MappedWorld:
        sceneries = {"as mapped": Scenery(mesh)} | (
            {} if changed is None else {"another day": Scenery(other_day)}
        )
        return MappedWorld(mesh, None, sceneries)

    missing = None if mesh.exists() and other_day.exists() else f"{name} is not beside the checkout"
    return FittedWorld(name, name, "os1-64", make, missing)


def _own(kind: str, seed: int, *, from_cloud: bool) -> FittedWorld:
    """A world of ``firstfix world``, the same on another day, and with all gone that can be moved."""
    name = f"{kind}_{seed}_{'cloud' if from_cloud else 'mesh'}"

    def make(folder: Path) -> MappedWorld:
        if not (folder / "emptied.ply").exists():
            write_world(make_world(kind, seed=seed), folder)
            place = layout(kind, seed)
            changed = place.changed_mesh(np.random.default_rng([seed, NAMES.index(kind), 2]))
            (folder / "changed.ply").write_bytes(ply_of_mesh(changed))
            (folder / "emptied.ply").write_bytes(ply_of_mesh(Mesh.joined(place.fixed)))
        if not (folder / "look_alike.txt").exists():
            other = layout(kind, seed + LOOK_ALIKE_SEED)
            (folder / "look_alike.ply").write_bytes(ply_of_mesh(other.mesh()))
            write_drive(other, folder / "look_alike.txt")
        trajectory = folder / "trajectory.txt"
        sceneries = {
            "as mapped": Scenery(folder / "mesh.ply", trajectory),
            "another day": Scenery(folder / "changed.ply", trajectory),
            "emptied": Scenery(folder / "emptied.ply", trajectory),
        }
        look_alike = Scenery(folder / "look_alike.ply", folder / "look_alike.txt")
        return MappedWorld(
            folder / ("map.ply" if from_cloud else "mesh.ply"), trajectory, sceneries, look_alike
        )

    return FittedWorld(name, kind, _SENSORS[kind], make)


_SENSORS = {"factory": "os1-64", "office": "os0-64", "campus": "os1-64"}
FITTED_WORLDS = (
    _shared("warehouse_aws_small"),
    _shared("hospital_aws_1floor"),
    _shared("office_willow_garage"),
    _shared("office_clearpath", changed="office_construction_clearpath"),
    _own("factory", 11, from_cloud=True),
    _own("office", 11, from_cloud=False),
    _own("office", 12, from_cloud=True),
    _own("campus", 11, from_cloud=False),
    _own("campus", 12, from_cloud=True),
)

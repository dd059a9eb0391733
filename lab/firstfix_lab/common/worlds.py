"""Simulated worlds, each with all that the robust suite needs of it: mesh, other day, look-alike, queries.

The meshes of ``shared/data/worlds`` when they lie beside the checkout, and the project's own worlds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.store.sha256 import sha256_of
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.sources.read_map import read_map, read_trajectory
from firstfix_builder.viewpoints.sample import sample_viewpoints
from firstfix_cli import sample_world
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_cli.sample_world.drive import drive
from firstfix_cli.sample_world.factory import factory
from firstfix_cli.sample_world.place import Place
from firstfix_cli.sample_world.write_world import ply_of_mesh, write_world
from tests.recorded_data import SHARED

from .. import worlds as own_worlds
from ..worlds import NAMES, make_world
from ..worlds.campus import campus
from ..worlds.farm import farm
from ..worlds.office import CLEAR_M, CORRIDOR, STAIR_X, STAIR_Y, STOREY_M, office

SEED = 0
_PACKAGES = [Path(package.__file__).parent for package in (sample_world, own_worlds)]
# The builder's source_hash does not cover this package: caches would keep a world that has changed.
WORLDS_SOURCE = {
    path.name: sha256_of(path)
    for path in sorted([Path(__file__), *(path for folder in _PACKAGES for path in folder.rglob("*.py"))])
    if path.name != "__init__.py"
}
_LAYOUTS: dict[str, Callable[[np.random.Generator], Place]] = {
    "factory": factory,
    "office": office,
    "campus": campus,
    "farm": farm,
}


@dataclass(frozen=True)
class Scenery:
    """Surfaces to simulate scans in, and a path on the floors where a robot may stand.

    Attributes:
        mesh: a file.
        trajectory: TUM file of sensor poses, or None: the largest floors.
        above_m: only the floors above this height, where a place has storeys.
    """

    mesh: Path
    trajectory: Path | None = None
    above_m: float = -np.inf

    def simulator(self) -> Simulator:
        """In the frame of the file."""
        data = read_map(self.mesh)
        assert data.vertices is not None
        assert data.triangles is not None
        return Simulator(data.vertices + data.origin, data.triangles)

    def viewpoints(self, simulator: Simulator, mount_height_m: float) -> NDArray[np.float64]:
        """(n, 3) sensor positions a metre apart."""
        poses = None if self.trajectory is None else read_trajectory(self.trajectory)
        found = sample_viewpoints(simulator, ViewpointConfig(spacing_m=1.0), mount_height_m, poses)
        return found.positions[found.floor_z > self.above_m]


@dataclass(frozen=True)
class WorldFiles:
    """A world on disk.

    Attributes:
        map: the surfaces, and what the templates are made of if there is no cloud.
        cloud: what a mapping run left of the map, for the build to start from, or None.
        changed: the same place on another day, or None.
        emptied: the same place with all gone that can be moved, or None.
        look_alikes: places outside the map that look like it.
        poses: ``poses.csv`` of the world's own query scans, or None.
    """

    map: Scenery
    changed: Scenery | None = None
    emptied: Scenery | None = None
    look_alikes: tuple[Scenery, ...] = ()
    poses: Path | None = None
    cloud: Path | None = None

    @property
    def source(self) -> Path:
        """File that a build reads."""
        return self.map.mesh if self.cloud is None else self.cloud

    def own_queries(self) -> list[tuple[Scan, NDArray[np.float64] | None]]:
        """Scan with T_map_sensor, None where they are not of this map."""
        rows = [] if self.poses is None else read_poses_csv(self.poses)
        return [(read_scan_file(row.path), row.T_map_sensor) for row in rows]


@dataclass(frozen=True)
class BenchWorld:
    """A simulated world with everything that the suites need of it.

    Attributes:
        place: worlds of one place have the same: no scan of one is outside the other's map.
        config: of the build; its sensor is the world's own.
        make: a cache to the files; the shared ones lie there already.
        missing: why there is nothing, or None.
        large: its build takes minutes. The suite runs it only when it is named.
    """

    name: str
    place: str
    config: dict[str, Any]
    make: Callable[[StageCache], WorldFiles]
    missing: str | None = None
    large: bool = False


def shared_world(name: str, changed: str | None = None, **config: Any) -> BenchWorld:
    folder = SHARED / "worlds"
    other_day = None if changed is None else Scenery(folder / f"{changed}.ply")
    files = WorldFiles(Scenery(folder / f"{name}.ply"), other_day)
    there = files.map.mesh.exists() and (other_day is None or other_day.mesh.exists())
    missing = None if there else f"{name} is not beside the checkout"
    return BenchWorld(name, name, {"sensor": "os1-64"} | config, lambda cache: files, missing)


def own_world(
    kind: str, large: bool = False, mapped: bool = False, seed: int = SEED, look_alike_seed: int = SEED + 1
) -> BenchWorld:
    """A world of ``firstfix world``: another day of it, another seed as its look-alike, its own queries.

    Args:
        mapped: built from the cloud of the mapping run, which missed surfaces and drifted a little. The scans
            are still of the true surfaces.
    """

    def produce(out: Path) -> None:
        world, place = make_world(kind, seed=seed), layout(kind, seed)
        write_world(world, out)
        other_day = place.changed_mesh(np.random.default_rng([seed, NAMES.index(kind), 2]))
        (out / "changed.ply").write_bytes(ply_of_mesh(other_day))
        (out / "emptied.ply").write_bytes(ply_of_mesh(Mesh.joined(place.fixed)))
        other = layout(kind, look_alike_seed)
        (out / "look_alike.ply").write_bytes(ply_of_mesh(other.mesh()))
        write_drive(other, out / "look_alike.txt")

    def make(cache: StageCache) -> WorldFiles:
        recipe = {"kind": kind, "seed": seed, "look_alike_seed": look_alike_seed}
        out = cache.run("bench_world", WORLDS_SOURCE, recipe, produce).directory
        trajectory = out / "trajectory.txt"
        return WorldFiles(
            Scenery(out / "mesh.ply", trajectory),
            Scenery(out / "changed.ply", trajectory),
            Scenery(out / "emptied.ply", trajectory),
            (Scenery(out / "look_alike.ply", out / "look_alike.txt"),),
            out / "poses.csv",
            out / "map.ply" if mapped else None,
        )

    config = {"sensor": _SENSORS[kind]} | _CONFIGS.get(kind, {})
    return BenchWorld(f"{kind}_mapped" if mapped else kind, kind, config, make, large=large)


def ground_floor() -> BenchWorld:
    """The office cut below its upper storey, which is then the look-alike."""

    def produce(out: Path) -> None:
        place = layout("office", SEED)
        mesh = place.mesh()
        (out / "whole.ply").write_bytes(ply_of_mesh(mesh))
        (out / "mesh.ply").write_bytes(ply_of_mesh(_without_upper_storey(mesh)))
        write_drive(place, out / "whole.txt")
        write_drive(place, out / "trajectory.txt", below_m=STOREY_M / 2)

    def make(cache: StageCache) -> WorldFiles:
        out = cache.run("bench_ground_floor", WORLDS_SOURCE, {}, produce).directory
        upper = Scenery(out / "whole.ply", out / "whole.txt", above_m=STOREY_M - 0.5)
        return WorldFiles(Scenery(out / "mesh.ply", out / "trajectory.txt"), look_alikes=(upper,))

    return BenchWorld("office_ground_floor", "office", {"sensor": _SENSORS["office"]}, make)


def _without_upper_storey(mesh: Mesh) -> Mesh:
    """The office up to its lower ceiling; the stair ends half way, or a robot would climb onto that."""
    corners = mesh.vertices[mesh.triangles]  # (t, 3, 3)
    x, y, z = corners.mean(axis=1).T
    in_stairwell = (x > 0.2) & (x < STAIR_X - 0.15) & (y > CORRIDOR[1] + 0.07) & (y < STAIR_Y - 0.11)
    stair = in_stairwell & (z > STOREY_M / 3) & (z < CLEAR_M - 0.05)
    return mesh.with_triangles((corners[:, :, 2] <= CLEAR_M + 0.01).all(axis=1) & ~stair)


def layout(name: str, seed: int) -> Place:
    """The place that ``make_world`` drives through."""
    return _LAYOUTS[name](np.random.default_rng([seed, NAMES.index(name), 0]))


def write_drive(place: Place, path: Path, below_m: float = np.inf) -> None:
    """TUM, all headings alike: only where the floors are is read from it."""
    at = drive(place)[:, :3, 3]
    at = at[at[:, 2] - place.sensor.mount_height_m < below_m]
    lines = [f"{k} {x:.4f} {y:.4f} {z:.4f} 0 0 0 1" for k, (x, y, z) in enumerate(at)]
    path.write_text("\n".join(lines) + "\n")


_SENSORS = {"factory": "os1-64", "office": "os0-64", "campus": "os1-64", "farm": "vlp-16"}
_CONFIGS = {"campus": {"viewpoints": {"spacing_m": 0.45}}}  # 108,000 templates
WORLDS = (
    shared_world("warehouse_aws_small"),
    shared_world("hospital_aws_1floor"),
    shared_world("office_willow_garage"),
    shared_world("office_clearpath", changed="office_construction_clearpath"),
    own_world("factory"),
    own_world("office"),
    ground_floor(),
    own_world("campus", large=True),
    own_world("farm"),
    shared_world("inspection_clearpath", sensor="vlp-16", viewpoints={"spacing_m": 1.0}),
    own_world("office", mapped=True),
)

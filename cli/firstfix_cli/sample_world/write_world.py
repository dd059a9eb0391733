"""A world as files: the formats that SLAM packages and drivers leave behind."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from firstfix.transform import quaternion_of
from firstfix_builder.mesh.mesh import Mesh

from .make_world import World
from .query import WorldQuery

SPEED_M_S = 0.8  # for the trajectory's time stamps


def write_world(world: World, directory: Path) -> None:
    """Write mesh, map, trajectory, sensor, query scans and their poses below the directory.

    Files: mesh.ply, map.ply, trajectory.txt (TUM), sensor.yaml, scans/NNN.pcd, poses.csv, README.txt.
    The same world gives the same bytes.
    """
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "mesh.ply").write_bytes(ply_of_mesh(world.mesh))
    (directory / "map.ply").write_bytes(ply_of_cloud(world.cloud))
    (directory / "trajectory.txt").write_text(_tum(world.trajectory))
    (directory / "sensor.yaml").write_text(yaml.safe_dump(world.sensor.to_mapping(), sort_keys=False))
    write_queries(directory, world.queries)
    (directory / "README.txt").write_text(_readme(world))


def write_sample(world: World, directory: Path) -> str:
    """Write a world below the directory, and return what it has, in a line."""
    write_world(world, directory)
    return (
        f"{len(world.cloud):,} map points, {len(world.trajectory):,} poses of the mapping drive, "
        f"{len(world.queries)} query scans of {world.sensor.name}"
    )


def write_queries(directory: Path, queries: Iterable[WorldQuery]) -> None:
    """Write scans/NNN.pcd and poses.csv."""
    scans = directory / "scans"
    scans.mkdir(parents=True, exist_ok=True)
    rows = ["scan,tx,ty,tz,qx,qy,qz,qw"]
    for k, query in enumerate(queries):
        (scans / f"{k:03}.pcd").write_bytes(pcd_of_points(query.scan.points))
        pose = "," * 6 if query.T_map_sensor is None else ",".join(_pose_numbers(query.T_map_sensor))
        rows.append(f"scans/{k:03}.pcd,{pose}")
    (directory / "poses.csv").write_text("\n".join(rows) + "\n")


def ply_of_cloud(points: NDArray[np.floating]) -> bytes:
    """(n, 3) points as binary little-endian PLY with float32 coordinates."""
    header = _ply_header([f"element vertex {len(points)}", *_XYZ])
    return header + np.ascontiguousarray(points, "<f4").tobytes()


def ply_of_mesh(mesh: Mesh) -> bytes:
    """Vertices and triangles as binary little-endian PLY."""
    faces = np.empty(len(mesh.triangles), np.dtype([("count", "u1"), ("corners", "<i4", 3)]))
    faces["count"], faces["corners"] = 3, mesh.triangles
    lines = [
        f"element vertex {len(mesh.vertices)}",
        *_XYZ,
        f"element face {len(mesh.triangles)}",
        "property list uchar int vertex_indices",
    ]
    return _ply_header(lines) + np.ascontiguousarray(mesh.vertices, "<f4").tobytes() + faces.tobytes()


def pcd_of_points(points: NDArray[np.floating]) -> bytes:
    """(n, 3) points as binary PCD 0.7 with float32 coordinates."""
    n = len(points)
    header = (
        "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\n"
        f"COUNT 1 1 1\nWIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary\n"
    )
    return header.encode() + np.ascontiguousarray(points, "<f4").tobytes()


_XYZ = ["property float x", "property float y", "property float z"]


def _ply_header(lines: list[str]) -> bytes:
    return "\n".join(["ply", "format binary_little_endian 1.0", *lines, "end_header", ""]).encode()


def _tum(trajectory: NDArray[np.float64]) -> str:
    """Lines of t x y z qx qy qz qw; the clock starts at 0 and the robot keeps its pace."""
    steps = np.linalg.norm(np.diff(trajectory[:, :3, 3], axis=0), axis=1)
    times = np.concatenate([[0.0], np.cumsum(steps)]) / SPEED_M_S
    lines = [f"{t:.3f} {' '.join(_pose_numbers(T))}" for t, T in zip(times, trajectory, strict=True)]
    return "\n".join(lines) + "\n"


def _pose_numbers(T: NDArray[np.float64]) -> list[str]:
    return [f"{v:.6f}" for v in T[:3, 3]] + [f"{v:.9f}" for v in quaternion_of(T)]


def _readme(world: World) -> str:
    known = sum(query.T_map_sensor is not None for query in world.queries)
    return f"""\
Sample world "{world.name}" of firstfix, seed {world.seed}. Made by a program; free to use.

mesh.ply        the true surfaces when the map was made: {len(world.mesh.triangles)} triangles
map.ply         the cloud that a SLAM run would leave: {len(world.cloud)} points, metres, z up
trajectory.txt  T_map_sensor of that run: t x y z qx qy qz qw (TUM), {len(world.trajectory)} poses
sensor.yaml     the LiDAR model ({world.sensor.name})
scans/          query scans in the sensor frame, taken later: things have moved, people pass by
poses.csv       T_map_sensor of each query scan; an empty pose means "not in this map"
                ({known} scans in the map, {len(world.queries) - known} not)

Map and trajectory carry the same slow drift of up to 3 cm against the mesh; poses are in the map's frame.
"""

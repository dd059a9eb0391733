"""Small folders as mapping programs write them. Each was held against the program, or its source.

| writer | program and version | held against |
|---|---|---|
| write_divided_map | Autoware, map_loader of autoware_core 1.0 | the documented form |
| write_intervals | FAST-LIO (pcd_save/interval) | src/laserMapping.cpp |
| write_kiss_slam | kiss-slam 0.0.2 | a run on 100 simulated scans, the sensor leaning by 10 degrees |
| write_rtabmap | rtabmap 0.21, rtabmap-export | tools/Export/main.cpp, Graph.cpp |
| write_hdmapping | HDMapping 0.9 | core/src/session.cpp, point_clouds.cpp, lidar_odometry_step_1 |
| write_sc_lio_sam | SC-LIO-SAM | src/mapOptmization.cpp, tools/python/makeMergedMap.py |
| write_hdl_graph_slam | hdl_graph_slam (map dump) | src/hdl_graph_slam/keyframe.cpp |
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import laspy
import numpy as np

from firstfix.transform import inverse, quaternion_of, transform_points

Points, Poses = np.ndarray, Sequence[np.ndarray]


def write_pcd(path: Path, points: Points) -> None:
    head = f"FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {len(points)}\nHEIGHT 1\nPOINTS {len(points)}\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(f"{head}DATA binary\n".encode() + np.asarray(points, "<f4").tobytes())


def write_ply(path: Path, points: Points) -> None:
    head = f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(head.encode() + np.asarray(points, "<f4").tobytes())


def tum(poses: Poses, after: str = "") -> str:
    rows = ([number, *T[:3, 3], *quaternion_of(T)] for number, T in enumerate(poses))
    return "".join(
        " ".join(f"{value:.9f}" for value in row) + after.format(n=n + 1) + "\n" for n, row in enumerate(rows)
    )


def kitti(poses: Poses) -> str:
    return "".join(" ".join(f"{value:.9f}" for value in T[:3].ravel()) + "\n" for T in poses)


def write_divided_map(
    folder: Path, points: Points, tiles: str = "pointcloud_map.pcd", size: int = 20
) -> None:
    cells = np.floor(points[:, :2] / size).astype(int) * size
    listed = [f"x_resolution: {size}.0\ny_resolution: {size}.0"]
    for x, y in np.unique(cells, axis=0):
        write_pcd(folder / tiles / f"map_{x}_{y}.pcd", points[(cells == [x, y]).all(axis=1)])
        listed.append(f"map_{x}_{y}.pcd: [{x}, {y}]")
    (folder / "pointcloud_map_metadata.yaml").write_text("\n".join(listed) + "\n")
    (folder / "map_projector_info.yaml").write_text(
        "projector_type: MGRS\nvertical_datum: EGM2008\nmgrs_grid: 54SVE\n"
    )


def write_intervals(folder: Path, parts: Sequence[Points], rest: Points | None = None) -> None:
    for number, part in enumerate(parts, start=1):
        write_pcd(folder / f"scans_{number}.pcd", part)
    if rest is not None:
        write_pcd(folder / "scans.pcd", rest)


def write_kiss_slam(folder: Path, local_maps: Sequence[Points], poses: Poses, levelled: Points) -> None:
    for number, points in enumerate(local_maps):
        write_ply(folder / f"local_maps/plys/{number:06d}.ply", points)
    vertices = "".join(f"VERTEX_SE3:QUAT {row}" for row in tum(poses).splitlines(keepends=True))
    (folder / "local_maps/local_map_graph.g2o").write_text(vertices + "FIX 0\n")
    write_ply(folder / "occupancy_grid/occupancy_pcd.ply", levelled)
    (folder / "occupancy_grid/occupancy_grid_bonxai.bin").write_bytes(b"Bonxai::VoxelGrid" + bytes(99))
    np.save(folder / "hall_poses.npy", np.array(poses))
    (folder / "hall_poses_tum.txt").write_text(tum(poses))
    (folder / "hall_poses_kitti.txt").write_text(kitti(poses))
    (folder / "config.yml").write_text("out_dir: slam_output\n")


def write_rtabmap(folder: Path, points: Points, poses: Poses, kinds: Sequence[str] = ("", "_scan")) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    write_ply(folder / "office_cloud.ply", points)
    for kind in kinds:
        rows = tum([*poses, np.eye(4)], " {n}").replace(f" {len(poses) + 1}\n", " -7\n")  # a landmark
        (folder / f"office{kind}_poses.txt").write_text("#timestamp x y z qx qy qz qw id\n" + rows)


def write_hdmapping(
    folder: Path, chunks: Sequence[Points], ways: Sequence[Poses], offset: Sequence[float] = (0, 0, 0)
) -> None:
    """Chunks and ways in the session's frame; each chunk's frame is the first pose of its way."""
    folder.mkdir(parents=True, exist_ok=True)
    names = " ".join(f"pose{row}{column}" for row in range(3) for column in range(4))
    listed = [str(len(chunks))]
    for number, (points, way) in enumerate(zip(chunks, ways, strict=True)):
        las = laspy.create(point_format=1, file_version="1.2")
        las.header.scales = [0.0001] * 3
        las.x, las.y, las.z = transform_points(inverse(way[0]), points).T
        las.write(folder / f"scan_lio_{number}.laz")
        rows = [f"{10**9 * n} {kitti([inverse(way[0]) @ T]).strip()} 0 0 0 0" for n, T in enumerate(way)]
        head = f"timestamp_nanoseconds {names} timestampUnix_nanoseconds om_rad fi_rad ka_rad"
        (folder / f"trajectory_lio_{number}.csv").write_text("\n".join([head, *rows]) + "\n")
        matrix = [" ".join(f"{value:.9f}" for value in row) for row in way[0]]
        listed += [f"scan_lio_{number}.laz", *matrix]
    for name in ("poses.reg", "lio_initial_poses.reg"):
        (folder / name).write_text("\n".join(listed) + "\n")
    settings = {f"offset_{axis}": value for axis, value in zip("xyz", offset, strict=True)}
    settings["poses_file_name"] = "C:\\runs\\lio_result_0\\poses.reg"
    files = [{"file_name": f"C:\\runs\\lio_result_0\\scan_lio_{n}.laz"} for n in range(len(chunks))]
    session = {"Session Settings": settings, "loop_closure_edges": None, "laz_file_names": files}
    (folder / "session.json").write_text(json.dumps(session))


def write_sc_lio_sam(folder: Path, scans: Sequence[Points], poses: Poses) -> None:
    """Scans in the sensor's frame."""
    for number, points in enumerate(scans):
        write_pcd(folder / f"Scans/{number:06d}.pcd", points)
        (folder / "SCDs").mkdir(exist_ok=True)
        (folder / f"SCDs/{number:06d}.scd").write_text("0.1 0.2\n")
    (folder / "optimized_poses.txt").write_text(kitti(poses))
    (folder / "odom_poses.txt").write_text(kitti([np.eye(4)] * len(poses)))
    (folder / "times.txt").write_text("".join(f"{n / 10}\n" for n in range(len(poses))))
    (folder / "singlesession_posegraph.g2o").write_text("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n")


def write_hdl_graph_slam(folder: Path, scans: Sequence[Points], poses: Poses) -> None:
    """Scans in the sensor's frame."""
    for number, (points, T) in enumerate(zip(scans, poses, strict=True)):
        write_pcd(folder / f"{number:06d}/cloud.pcd", points)
        rows = [" ".join(f"{value:11.6g}" for value in row) for row in T]
        odom = [" ".join(f"{value:.0f}" for value in row) for row in np.eye(4)]
        told = [f"stamp {1_500_000_000 + number} 0", "estimate", *rows, "odom", *odom]
        told += ["accum_distance 1.5", "floor_coeffs 0 0 1 1.2", f"id {number}"]
        (folder / f"{number:06d}/data").write_text("\n".join(told) + "\n")
    (folder / "graph.g2o").write_text("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n")
    (folder / "graph.g2o.kernels").write_text("\n")
    (folder / "special_nodes.csv").write_text("anchor_node -1\nanchor_edge -1\nfloor_node -1\n")

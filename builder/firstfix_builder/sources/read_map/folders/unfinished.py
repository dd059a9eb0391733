"""Programs' folders of which a part is missing: what it is, in words."""

from __future__ import annotations

from pathlib import Path


def missing_part(path: Path) -> str:
    """Parts that a program's folder lacks to be a map; empty: it is no known program's."""
    poses, scans = path / "optimized_poses.txt", path / "Scans"
    if scans.is_dir() and any(scans.glob("[!.]*.pcd")):
        return f"SC-LIO-SAM's scans without their poses: {poses.name} is not beside Scans"
    if poses.is_file():
        return (
            f"SC-LIO-SAM's poses ({poses.name}) without their scans: Scans with its .pcd files is not there"
        )
    if (path / "graph.g2o").is_file():
        return "hdl_graph_slam's graph without its keyframes: 000000/data and 000000/cloud.pcd are not there"
    if any(path.glob("[!.]*_poses.npy")):
        return (
            "poses of KISS-ICP or KISS-SLAM without a map: local_maps/plys with its .ply files is not there"
        )
    return ""

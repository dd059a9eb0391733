"""The first stage of a build: a source becomes a map in its levelled local frame."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.transform import inverse, make_transform, transform_points

from .check_map.check_map import check_map, refuse
from .mesh.clean_cloud import clean_cloud
from .mesh.level import level_frame
from .mesh.mesh import Mesh
from .mesh.places.tiled_points import TiledPoints
from .mesh.tiled_mesh import write_tiled_mesh
from .read_map import read_parts
from .read_map.held_out import read_held_out
from .read_map.mapping_scans import MappingScans
from .read_map.without_moving import without_moving
from .stage_files import MOVING_FILE, write_findings, write_json


def write_level_map(source: Path, trajectory: Path | None, config: BuildConfig, out: Path) -> None:
    """Writes points or a mesh, the trajectory, held-out scans, findings, and T_map_level.

    Args:
        source: a map file or folder, as ``read_map`` takes it.
        trajectory: poses of the mapping run, if they are not in the source.
        out: the stage's folder.

    Raises:
        InputError: the source or the trajectory cannot be read.
        BuildFailed: a finding refuses the map.
    """
    axis, scale = config.axis, config.scale
    parts = read_parts(source, axis=axis, scale=scale, trajectory=trajectory)
    data = next(parts)
    poses = data.trajectory
    findings = check_map(data, poses)
    refuse(findings)
    write_findings(findings, out)
    T_map_level = np.eye(4)
    if data.points is not None:
        T_map_level = level_frame(data.points) if config.level else T_map_level
        T_level_map = inverse(T_map_level)
        cloud = clean_cloud(transform_points(T_level_map, data.points), config.clean)
        scans = MappingScans(source, axis, scale)
        if config.clean.passes and (len(scans) or scans.left_out):
            to_origin = make_transform(np.eye(3), -data.origin)
            cloud, moving = without_moving(cloud, scans, T_level_map @ to_origin, config.clean)
            write_json(out / MOVING_FILE, moving.to_mapping())
        TiledPoints.of(cloud).save(out)
    else:
        write_tiled_mesh((Mesh(*part.surface) for part in chain([data], parts)), out)
    if poses is not None:
        np.save(out / "trajectory.npy", inverse(T_map_level) @ poses)
    # answers are in the file's own coordinates: the local origin goes back in here
    T_map_level = make_transform(np.eye(3), data.origin) @ T_map_level
    np.save(out / "T_map_level.npy", T_map_level)
    held_out = read_held_out(source, axis, scale)
    if held_out is not None:
        held_out.moved(inverse(T_map_level)).save(out)

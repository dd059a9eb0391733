"""A map as it was read becomes one in its levelled local frame: checked, clean, without moving things."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.findings.finding import Finding
from firstfix.transform import Matrix, inverse, make_transform, transform_points

from ..mesh.clean_cloud import clean_cloud
from ..mesh.intensity import Intensity, as_column, from_column
from ..mesh.level import level_frame
from ..mesh.mesh import Mesh
from ..mesh.places.tiled_points import TiledPoints
from ..mesh.tiled_mesh import write_tiled_mesh
from ..stage_files import TRAJECTORY_FILE, write_json
from ..stage_results import FINDINGS_FILE, INTENSITY_FILE, MOVING_FILE, T_MAP_LEVEL_FILE
from .check_map.check_map import check_map, has_fit_poses, refuse
from .check_map.sensor_poses import with_sensor_poses
from .check_map.shape import Shape
from .read_map import MapData, read_parts
from .read_map.file_errors import naming
from .read_map.held_out import HeldOut, read_held_out
from .read_map.map_of_scans import MapOfScans, is_map_of_scans, read_map_of_scans
from .read_map.mapping_scans import MappingScans
from .read_map.posed_cloud import OnPosedCloud, PosedCloud
from .read_map.read_map import in_local_frame
from .read_map.without_moving import Moving, without_moving

MORE_POINTS = 2  # of joined scans than cleaning leaves: it shall have a choice


def write_level_map(
    source: Path,
    trajectory: Path | None,
    config: BuildConfig,
    out: Path,
    *,
    read: Callable[[Path], MapData] | None = None,
    on_posed_cloud: OnPosedCloud | None = None,
) -> None:
    """Write points or a mesh, the trajectory, held-out scans, findings, and T_map_level.

    Args:
        source: a map file or folder, as ``read_map`` takes it, or whatever ``read`` reads.
        trajectory: poses of the mapping run, if they are not in the source.
        out: the stage's folder.
        read: reads a source of another kind, in its own frame.
        on_posed_cloud: called, where the map is a cloud with poses, as soon as nothing refuses it.

    Raises:
        InputError: the source or the trajectory cannot be read.
        BuildFailed: a finding refuses the map.
    """
    axis, scale = config.axis, config.scale
    made = _made_of_scans(source, config) if read is None else None
    if read is not None:
        with naming(source):
            parts = iter([in_local_frame(read(source), axis, scale, trajectory)])
    elif made is None:
        parts = read_parts(source, axis=axis, scale=scale, trajectory=trajectory)
    else:
        parts = iter([in_local_frame(made.data, axis, scale, trajectory)])
    data = with_sensor_poses(next(parts), config.trajectory_mount_height_m)
    held_out = _held_out(source, made, config)

    @cache
    def level() -> Matrix:
        assert data.points is not None
        return level_frame(data.points) if config.level else np.eye(4)

    def before_warnings(found: Sequence[Finding], shape: Shape) -> None:
        if on_posed_cloud is None or data.points is None or data.trajectory is None:
            return
        if shape.spacing_m and has_fit_poses(found):
            on_posed_cloud(_posed_cloud(data, level(), shape.spacing_m, found, held_out or HeldOut()))

    findings = check_map(data, data.trajectory, before_warnings)
    refuse(findings)
    poses = data.trajectory if has_fit_poses(findings) else None
    write_findings(findings, out)
    T_map_level = np.eye(4)
    if data.points is not None:
        T_map_level = level()
        T_level_map = inverse(T_map_level)
        rows = as_column(transform_points(T_level_map, data.points), data.intensity)
        data = replace(data, points=None)  # a large map is not held twice
        cleaned = clean_cloud(rows, config.clean)
        del rows
        cloud, intensity = from_column(cleaned, data.intensity)
        to_origin = make_transform(np.eye(3), -data.origin)
        kept, moving = _without_moving(cloud, source, made, T_level_map @ to_origin, config)
        if moving is not None:
            write_json(out / MOVING_FILE, moving.to_mapping())
        if kept is not None:
            cloud, intensity = cloud[kept], None if intensity is None else intensity.at(kept)
        write_cloud(cloud, intensity, out)
    else:
        write_tiled_mesh((Mesh(*part.surface) for part in chain([data], parts)), out)
    if poses is not None:
        np.save(out / TRAJECTORY_FILE, inverse(T_map_level) @ poses)
    # answers are in the file's own coordinates: the local origin goes back in here
    T_map_level = make_transform(np.eye(3), data.origin) @ T_map_level
    np.save(out / T_MAP_LEVEL_FILE, T_map_level)
    if held_out is not None:
        held_out.moved(inverse(T_map_level)).save(out)


def write_cloud(cloud: NDArray[np.float64], intensity: Intensity | None, out: Path) -> None:
    """Write the (n, 3) points of a level map in tiles, and their intensity, for ``LevelMap``."""
    tiled, order = TiledPoints.sorted(cloud)
    tiled.save(out)
    if intensity is not None:
        intensity.at(order).save(out / INTENSITY_FILE)


def _held_out(source: Path, made: MapOfScans | None, config: BuildConfig) -> HeldOut | None:
    """Scans of the source that are not among the map's points; None: it has no place for any."""
    brought = read_held_out(source, config.axis, config.scale)
    if made is None:
        return brought
    return made.held_out if brought is None else made.held_out.with_those(brought)


def _posed_cloud(
    data: MapData, T_map_level: Matrix, spacing_m: float, found: Sequence[Finding], held_out: HeldOut
) -> PosedCloud:
    """A map's points with its poses, in the level frame."""
    assert data.points is not None
    assert data.trajectory is not None
    T_level_map = inverse(T_map_level)
    is_level = np.array_equal(T_map_level, np.eye(4))
    T_source_level = make_transform(np.eye(3), data.origin) @ T_map_level
    return PosedCloud(
        data.points if is_level else transform_points(T_level_map, data.points),
        T_level_map @ data.trajectory,
        spacing_m,
        T_source_level,
        [one.to_mapping() for one in found],
        held_out.moved(inverse(T_source_level)),
    )


def write_findings(findings: Sequence[Finding], out: Path) -> None:
    """Write the findings of a map for ``LevelMap.findings``."""
    (out / FINDINGS_FILE).write_text(json.dumps([one.to_mapping() for one in findings]) + "\n")


def _made_of_scans(source: Path, config: BuildConfig) -> MapOfScans | None:
    """The map of a folder that brings its scans and no map file; None of any other source."""
    if not is_map_of_scans(source):
        return None
    with naming(source):
        return read_map_of_scans(
            source,
            config.axis,
            config.scale,
            held_out=config.self_test.held_out,
            max_points=MORE_POINTS * config.clean.max_points,
        )


def _without_moving(
    cloud: NDArray[np.float64],
    source: Path,
    made: MapOfScans | None,
    T_level_source: Matrix,
    config: BuildConfig,
) -> tuple[NDArray[np.bool_] | None, Moving | None]:
    """Which points are not of moving things, and what the mapping scans tell; None: nothing."""
    held_out = frozenset[str]() if made is None else made.names_held_out
    scans = MappingScans(source, config.axis, config.scale, without=held_out)
    if made is not None:
        scans.left_out.update(made.left_out)  # all were read for it; below only some are
    if not len(scans) and not scans.left_out:
        return None, None
    if not config.clean.passes:
        return None, None if made is None else Moving(0, 0.0, 0.0, dict(scans.left_out))
    return without_moving(cloud, scans, T_level_source, config.clean)

"""The build flow: a map becomes a version's files. Reads as its own table of contents."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.calibration import Calibration
from firstfix.engine_config import EngineConfig
from firstfix.errors import BuildCancelled
from firstfix.key_search import KeySearch
from firstfix.localizer import Localizer
from firstfix.manifest import Manifest
from firstfix.map_index import CALIBRATION_FILE, ENGINE_FILE, KEYS_FILE, MAP_FILE, MapIndex
from firstfix.templates import Templates
from firstfix.transform import inverse, make_transform, transform_points

from .clean_cloud import clean_cloud, point_spacing_m, voxel_means
from .config import BuildConfig
from .content_hash import content_hash
from .die_with_parent import die_with_parent
from .fit_engine import fit_engine
from .fit_spacing import sample_fitting_viewpoints
from .map_level import level_frame
from .mesh import Mesh
from .preview import draw_preview
from .read_map import read_map, read_trajectory
from .reconstruct_mesh import reconstruct_mesh
from .self_test import self_test
from .simulate import Simulator
from .stage_cache import StageCache, StageResult
from .templates import make_templates, view_distance_m
from .visible_points import visible_points

Progress = Callable[[str, float], None]
STAGES = ("read_map", "reconstruct_mesh", "sample_viewpoints", "make_templates", "build_index", "self_test")
SURFACE_STEP_M = 0.1  # between the points that stand for a mesh in registration


@dataclass(frozen=True)
class BuiltVersion:
    """A version that is ready to be published: every file in ``directory`` stands in the manifest."""

    directory: Path
    manifest: Manifest


def build_version(
    source: Path,
    config: BuildConfig,
    work: Path,
    *,
    trajectory: Path | None = None,
    progress: Progress = lambda stage, fraction: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> BuiltVersion:
    """Runs every stage that the cache under ``work`` does not hold yet.

    Args:
        source: a map file or folder, as ``read_map`` takes it.
        trajectory: poses of the mapping run, if they are not in the source.

    Raises:
        InputError: the source or the trajectory cannot be read.
        BuildFailed: a stage could not do its work.
        BuildCancelled: cancelled() said so.
    """
    workers = os.cpu_count() or 1
    with (
        ThreadPoolExecutor(workers) as threads,
        ProcessPoolExecutor(
            workers, mp_context=get_context("spawn"), initializer=die_with_parent
        ) as processes,
    ):
        build = _Build(config, StageCache(work), threads, processes, progress, cancelled)
        read = build.read_map(source, trajectory)
        mesh = build.reconstruct_mesh(read)
        viewpoints = build.sample_viewpoints(read, mesh)
        templates = build.make_templates(read, mesh, viewpoints)
        index = build.build_index(read, mesh, templates)
        tested = build.self_test(mesh, index)
        return build.collect(read, index, tested, work)


@dataclass(frozen=True)
class _Build:
    """One build's settings, and its stages: each takes earlier results and gives its own."""

    config: BuildConfig
    cache: StageCache
    threads: Executor
    processes: Executor
    progress: Progress
    cancelled: Callable[[], bool]

    def read_map(self, source: Path, trajectory: Path | None) -> StageResult:
        """The map in its levelled local frame: points or a mesh, trajectory, T_map_level."""

        def produce(out: Path) -> None:
            data = read_map(source, axis=self.config.axis)
            poses = data.trajectory
            if trajectory is not None:
                poses = read_trajectory(trajectory)
                poses[:, :3, 3] -= data.origin
            surface = data.points if data.points is not None else data.vertices
            assert surface is not None
            T_map_level = level_frame(surface) if self.config.level and data.points is not None else np.eye(4)
            T_level_map = inverse(T_map_level)
            if data.points is not None:
                np.save(
                    out / "points.npy",
                    clean_cloud(transform_points(T_level_map, data.points), self.config.clean),
                )
            elif data.vertices is not None and data.triangles is not None:
                Mesh(transform_points(T_level_map, data.vertices), data.triangles).save(out)
            if poses is not None:
                np.save(out / "trajectory.npy", T_level_map @ poses)
            # answers are in the file's own coordinates: the local origin goes back in here
            np.save(out / "T_map_level.npy", make_transform(np.eye(3), data.origin) @ T_map_level)

        inputs = {"source": content_hash(source)}
        if trajectory is not None:
            inputs["trajectory"] = content_hash(trajectory)
        chosen = {
            "axis": self.config.axis,
            "level": self.config.level,
            "clean": self.config.clean.model_dump(mode="json"),
            "names": [path.name for path in (source, trajectory) if path is not None],
        }
        return self._stage("read_map", inputs, chosen, produce)

    def reconstruct_mesh(self, read: StageResult) -> StageResult:
        def produce(out: Path) -> None:
            if (read.directory / "triangles.npy").exists():  # the source is a mesh: taken as it is
                Mesh.load(read.directory).save(out)
                return
            reconstruct_mesh(
                np.load(read.directory / "points.npy"),
                _trajectory(read),
                self.config.reconstruct,
                executor=self.processes,
                progress=self._ticks("reconstruct_mesh"),
                cancelled=self.cancelled,
            ).save(out)

        return self._stage("reconstruct_mesh", {"map": read.digest}, self.config.reconstruct, produce)

    def sample_viewpoints(self, read: StageResult, mesh: StageResult) -> StageResult:
        def produce(out: Path) -> None:
            found, spacing_m = sample_fitting_viewpoints(
                _simulator(mesh), self.config.viewpoints, self.config.sensor_model, _trajectory(read)
            )
            np.save(out / "positions.npy", found.positions)
            np.save(out / "floor_z.npy", found.floor_z)
            np.save(out / "spacing_m.npy", spacing_m)

        chosen = {
            "viewpoints": self.config.viewpoints.model_dump(mode="json"),
            "sensor": self.config.sensor_model.to_mapping(),
        }
        return self._stage("sample_viewpoints", {"map": read.digest, "mesh": mesh.digest}, chosen, produce)

    def make_templates(self, read: StageResult, mesh: StageResult, viewpoints: StageResult) -> StageResult:
        """Templates, their keys, and the engine's parameters that they were made with."""

        def produce(out: Path) -> None:
            simulator, sensor = _simulator(mesh), self.config.sensor_model
            positions = np.load(viewpoints.directory / "positions.npy")
            height_m = positions[:, 2] - np.load(viewpoints.directory / "floor_z.npy")
            engine = fit_engine(
                self.config.engine,
                sensor,
                _spacing_m(read),
                view_distance_m(simulator, positions, sensor),
                float(np.load(viewpoints.directory / "spacing_m.npy")),
                np.load(read.directory / "T_map_level.npy"),
            )
            templates, keys = make_templates(
                simulator,
                positions,
                height_m,
                sensor.coarser(self.config.simulate.max_rays),
                engine.descriptor,
                self.threads,
                self._ticks("make_templates"),
                self.cancelled,
            )
            templates.save(out)
            np.save(out / "keys.npy", keys)
            (out / ENGINE_FILE).write_text(engine.model_dump_json())

        chosen = {
            "sensor": self.config.sensor_model.to_mapping(),
            "simulate": self.config.simulate.model_dump(mode="json"),
            "engine": self.config.engine.model_dump(mode="json"),
        }
        inputs = {"map": read.digest, "mesh": mesh.digest, "viewpoints": viewpoints.digest}
        return self._stage("make_templates", inputs, chosen, produce)

    def build_index(self, read: StageResult, mesh: StageResult, templates: StageResult) -> StageResult:
        """All files of the version but what the self-test adds."""

        def produce(out: Path) -> None:
            for path in templates.directory.iterdir():
                if path.name != "keys.npy":
                    shutil.copyfile(path, out / path.name)
            KeySearch.build(np.load(templates.directory / "keys.npy")).save(out / KEYS_FILE)
            engine = EngineConfig.model_validate_json((out / ENGINE_FILE).read_text())
            templates_made = Templates.load(out)
            cloud = read.directory / "points.npy"
            points = (
                np.load(cloud)
                if cloud.exists()
                else visible_points(
                    _simulator(mesh), templates_made.position_m, self.config.sensor_model, SURFACE_STEP_M
                )
            )
            np.save(out / MAP_FILE, voxel_means(points, engine.registration.map_voxel_m).astype(np.float32))
            draw_preview(np.load(out / MAP_FILE), templates_made.position_m, out / "preview.png")

        inputs = {"map": read.digest, "mesh": mesh.digest, "templates": templates.digest}
        chosen = {"sensor": self.config.sensor_model.to_mapping()}
        return self._stage("build_index", inputs, chosen, produce)

    def self_test(self, mesh: StageResult, index: StageResult) -> StageResult:
        def produce(out: Path) -> None:
            found, calibration = self_test(
                Localizer(MapIndex.load(index.directory, Calibration())),
                _simulator(mesh),
                self.config.sensor_model,
                self.config.self_test,
                self.threads,
                self._ticks("self_test"),
                self.cancelled,
            )
            _write_json(out / CALIBRATION_FILE, calibration.to_mapping())
            _write_json(out / "self_test.json", found.to_mapping())

        chosen = {
            "self_test": self.config.self_test.model_dump(mode="json"),
            "sensor": self.config.sensor_model.to_mapping(),
        }
        return self._stage("self_test", {"mesh": mesh.digest, "index": index.digest}, chosen, produce)

    def collect(self, read: StageResult, index: StageResult, tested: StageResult, work: Path) -> BuiltVersion:
        """The version's folder with its manifest. Files are linked, not copied, where that works."""
        directory = work / "version"
        shutil.rmtree(directory, ignore_errors=True)
        directory.mkdir(parents=True)
        for path in sorted([*index.directory.iterdir(), *tested.directory.iterdir()]):
            _link(path, directory / path.name)
        points = np.load(directory / MAP_FILE, mmap_mode="r")
        manifest = Manifest.for_directory(
            directory,
            engine=json.loads((directory / ENGINE_FILE).read_text()),
            config=self.config.to_mapping(),
            sensor=self.config.sensor_model.to_mapping(),
            origin=np.load(read.directory / "T_map_level.npy")[:3, 3],
            source={"sha256": read.digest},
            counts={
                "templates": len(np.load(directory / "height_m.npy", mmap_mode="r")),
                "map_points": len(points),
            },
            self_test=json.loads((directory / "self_test.json").read_text()),
            bounds=(points.min(axis=0), points.max(axis=0)),
        )
        (directory / "manifest.json").write_bytes(manifest.to_json())
        return BuiltVersion(directory, manifest)

    def _stage(
        self, name: str, inputs: Mapping[str, str], config: Any, produce: Callable[[Path], None]
    ) -> StageResult:
        if self.cancelled():
            raise BuildCancelled(f"cancelled before {name}")
        self.progress(name, 0.0)
        result = self.cache.run(name, inputs, config, produce)
        self.progress(name, 1.0)
        return result

    def _ticks(self, stage: str) -> Callable[[float], None]:
        return lambda fraction: self.progress(stage, fraction)


def _trajectory(read: StageResult) -> NDArray[np.float64] | None:
    path = read.directory / "trajectory.npy"
    return np.load(path) if path.exists() else None


def _simulator(mesh: StageResult) -> Simulator:
    surface = Mesh.load(mesh.directory)
    return Simulator(surface.vertices, surface.triangles)


def _spacing_m(read: StageResult) -> float:
    path = read.directory / "points.npy"
    return point_spacing_m(np.load(path)) if path.exists() else SURFACE_STEP_M


def _write_json(path: Path, value: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(value, sort_keys=True, indent=1) + "\n")


def _link(source: Path, target: Path) -> None:
    try:
        target.hardlink_to(source)
    except OSError:  # another file system
        shutil.copyfile(source, target)

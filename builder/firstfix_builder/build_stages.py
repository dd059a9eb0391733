"""The stages of a build. Each takes the results of earlier stages; the cache may already hold its own."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import ENGINE_FILE, EngineConfig
from firstfix.engine.false_accept_bound import FILE_NAME as BOUND_FILE
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.index import CALIBRATION_FILE, MAP_FILE
from firstfix.engine.retrieval.cascade import Clusters, Templates, save_projection

from .execution.build_trace import within_a_stage
from .execution.chunks import Arrays, Chunk
from .execution.stage_cache import StageResult
from .execution.stage_runner import RunChunks, StageRunner
from .index.carve import carve_chunks, merged, poses_needed, seen_free
from .index.cloud_octree import draw_cloud
from .index.index_files import VIEWS_SHARE, write_index_files
from .index.key_scans import KeyScans, key_scan_chunks
from .index.learn_keys import is_worth_learning, learn_keys, scans_for
from .index.views import PROVISIONAL_REACHES, REACHES, view_chunks
from .level_map import write_level_map
from .mesh.clean_cloud import voxel_means
from .mesh.places.tiled_points import TiledPoints
from .mesh.reconstruct import block_meshes, mesh_chunks
from .mesh.tiled_mesh import TiledMesh, write_tiled_mesh
from .sources.read_map.map_of_scans import is_map_of_scans
from .sources.read_map.read_map import content_hash
from .stage_files import (
    engine_of,
    link,
    spacing_m_of,
    trajectory_of,
    write_json,
)
from .templates.cluster import cluster_by_pairs, cluster_chunks, cluster_templates
from .templates.fit_engine import fit_engine
from .templates.fit_spacing import fitting_viewpoints, write_places
from .templates.linkage import Pairs
from .templates.make import template_chunks, write_templates
from .tested_version import SelfTestInputs, write_self_test
from .viewpoints.workload import Workload

THINNED_M = 0.2  # between the points of a provisional version


@dataclass(frozen=True)
class BuildStages(StageRunner):
    """The stages of one build. Each takes the results of earlier stages and returns its own.

    Attributes:
        threads: run the work of ``self_test``.
        provisional: make a provisional version, whose index takes less work.
        workload: refuses maps of too many templates before the work is begun.
    """

    config: BuildConfig
    threads: Executor
    provisional: bool = False
    workload: Workload = field(default_factory=Workload)

    def read_map(self, source: Path, trajectory: Path | None) -> StageResult:
        """The map in its levelled local frame: points or a mesh, trajectory, T_map_level."""

        def produce(out: Path) -> None:
            write_level_map(source, trajectory, self.config, out)

        inputs = {"source": content_hash(source)}
        if trajectory is not None:
            inputs["trajectory"] = content_hash(trajectory)
        chosen = {
            "axis": self.config.axis,
            "scale": self.config.scale,
            "level": self.config.level,
            "clean": self.config.clean.model_dump(mode="json"),
            "held_out": self.config.self_test.held_out if is_map_of_scans(source) else None,
            "names": [path.name for path in (source, trajectory) if path is not None],
        }
        return self._stage("read_map", inputs, chosen, produce)

    def index_map(self, read: StageResult) -> tuple[StageResult, StageResult, StageResult]:
        """The surface of a map that was read, its viewpoints, and all that scans are localized with.

        All but the calibration, which ``self_test`` or ``assume_prior`` makes.
        """
        mesh = self.reconstruct_mesh(read)
        viewpoints = self.sample_viewpoints(read, mesh)
        fitted = self.fit_engine(read, viewpoints)
        engine = engine_of(fitted)
        templates = self.make_templates(mesh, viewpoints, engine)
        clusters = self.cluster(templates, engine)
        learned = self.learn_keys(mesh, templates, engine)
        carved = self.carve_free_space(read, mesh, engine)
        index = self.build_index(read, mesh, fitted, templates, clusters, learned, carved)
        return mesh, viewpoints, index

    def thin_map(self, read: StageResult) -> StageResult:
        """The map of ``read_map`` with fewer points, for a provisional version."""

        def produce(out: Path) -> None:
            for path in read.directory.iterdir():
                if not path.name.startswith("point"):
                    link(path, out / path.name)
            if (read.directory / "points.npy").exists():
                cloud = voxel_means(np.load(read.directory / "points.npy"), THINNED_M)
                TiledPoints.of(cloud).save(out)

        return self._stage("read_map", {"map": read.digest}, {"thinned_m": THINNED_M}, produce)

    def reconstruct_mesh(self, read: StageResult) -> StageResult:
        """The surface of the map, in tiles. A source that is a mesh stays as it is."""

        def produce(out: Path, run: RunChunks) -> None:
            if (read.directory / "triangles.npy").exists():  # the source is a mesh: taken as it is
                for path in read.directory.iterdir():
                    link(path, out / path.name)
            else:
                points = np.load(read.directory / "points.npy")
                self.workload.check_cloud(points, trajectory_of(read), self.config.viewpoints)
                chunks = mesh_chunks(points, trajectory_of(read), self.config.surface)
                write_tiled_mesh(block_meshes(run(chunks)), out)

        return self._chunked_stage("reconstruct_mesh", {"map": read}, self.config.surface, produce)

    def sample_viewpoints(self, read: StageResult, mesh: StageResult) -> StageResult:
        """The sensor positions of the templates, and how far one sees from them."""
        name, inputs = "sample_viewpoints", {"map": read.digest, "mesh": mesh.digest}
        chosen = {
            "viewpoints": self.config.viewpoints.model_dump(mode="json"),
            "sensor": self.config.sensor_model.to_mapping(),
        }

        def run(chunks: Sequence[Chunk], **places: StageResult) -> Iterator[Arrays]:
            reads = {"map": read, "mesh": mesh, **places}
            return self.chunks.run(name, chunks, reads, self._ticks(name), self.cancelled)

        def places_at(spacing_m: float) -> StageResult:
            def produce(out: Path) -> None:
                config, sensor = self.config.viewpoints, self.config.sensor_model
                tiled = TiledMesh.load(mesh.directory)
                self.workload.check_mesh(tiled, trajectory_of(read), config, spacing_m)
                write_places(run, read.directory, mesh.directory, config, spacing_m, sensor, out)

            with within_a_stage():
                return self.cache.run(name, inputs, {**chosen, "places_m": spacing_m}, produce)

        def produce(out: Path) -> None:
            fitting_viewpoints(
                places_at,
                lambda places, chunks: run(chunks, places=places),
                self.config.viewpoints,
                self.config.sensor_model,
                out,
            )
            found = np.load(out / "positions.npy", mmap_mode="r")
            self.workload.check_found(len(found), float(np.load(out / "spacing_m.npy")))

        return self._stage(name, inputs, chosen, produce)

    def fit_engine(self, read: StageResult, viewpoints: StageResult) -> StageResult:
        """The engine's parameters: what the version is made with and asked with."""

        def produce(out: Path) -> None:
            engine = fit_engine(
                self.config.engine,
                self.config.sensor_model,
                spacing_m_of(read),
                float(np.load(viewpoints.directory / "view_m.npy")),
                float(np.load(viewpoints.directory / "spacing_m.npy")),
                np.load(read.directory / "T_map_level.npy"),
            )
            (out / ENGINE_FILE).write_text(engine.model_dump_json())

        chosen = {
            "sensor": self.config.sensor_model.to_mapping(),
            "engine": self.config.engine.model_dump(mode="json"),
        }
        return self._stage(
            "fit_engine", {"map": read.digest, "viewpoints": viewpoints.digest}, chosen, produce
        )

    def make_templates(self, mesh: StageResult, viewpoints: StageResult, engine: EngineConfig) -> StageResult:
        """The templates: simulated scans at the viewpoints, described."""

        def produce(out: Path, run: RunChunks) -> None:
            positions = np.load(viewpoints.directory / "positions.npy")
            chunks = template_chunks(
                positions,
                np.load(viewpoints.directory / "chunk_start.npy"),
                self.config.viewpoints.tile_m,
                float(np.load(viewpoints.directory / "spacing_m.npy")),
                self.config.sensor_model.coarser(self.config.simulate.max_rays),
                engine.descriptor,
            )
            write_templates(run(chunks), len(positions), out)

        chosen = {
            "sensor": self.config.sensor_model.to_mapping(),
            "simulate": self.config.simulate.model_dump(mode="json"),
            "descriptor": engine.descriptor.model_dump(mode="json"),
        }
        return self._chunked_stage(
            "make_templates", {"mesh": mesh, "viewpoints": viewpoints}, chosen, produce
        )

    def cluster(self, templates: StageResult, engine: EngineConfig) -> StageResult:
        """Clusters of templates that look alike and are neighbours, each with its representative."""

        def produce(out: Path, run: RunChunks) -> None:
            descriptor = engine.descriptor.make()
            made = Templates.load(templates.directory, descriptor)
            config = engine.cluster
            if config is None:
                found = Clusters.alone(len(made))
            elif config.neighbours is None:
                found = cluster_templates(
                    descriptor,
                    made.described,
                    made.position_m,
                    config,
                    self._ticks("cluster"),
                    self.cancelled,
                )
            else:
                parts = run(cluster_chunks(len(made), config.neighbours, engine.descriptor))
                pairs = [Pairs(**part) for part in parts]
                found = cluster_by_pairs(descriptor, made.described, len(made), pairs, config)
            found.save(out)

        chosen = {
            "descriptor": engine.descriptor.model_dump(mode="json"),
            "cluster": None if engine.cluster is None else engine.cluster.model_dump(mode="json"),
        }
        return self._chunked_stage("cluster", {"templates": templates}, chosen, produce)

    def learn_keys(self, mesh: StageResult, templates: StageResult, engine: EngineConfig) -> StageResult:
        """The projection of the keys; nothing where the config or the map asks for none."""

        def produce(out: Path, run: RunChunks) -> None:
            made = Templates.load(templates.directory, engine.descriptor.make())
            if not is_worth_learning(len(made), engine, config):
                return
            scans = KeyScans(
                self.config.sensor_model.coarser(self.config.simulate.max_rays),
                config.perturb,
                engine.spacing_m,
                engine.preprocess,
                engine.descriptor,
                config.seed,
            )
            chunks = key_scan_chunks(made.position_m, scans_for(len(made), config), scans)
            projection = learn_keys(made, run(chunks), engine, config)
            if projection is not None:
                save_projection(projection, out)

        config = self.config.learn_keys
        chosen = {
            "learn_keys": config.model_dump(mode="json"),
            "sensor": self.config.sensor_model.to_mapping(),
            "simulate": self.config.simulate.model_dump(mode="json"),
            "engine": engine.model_dump(mode="json"),
        }
        return self._chunked_stage("learn_keys", {"mesh": mesh}, chosen, produce, {"templates": templates})

    def carve_free_space(self, read: StageResult, mesh: StageResult, engine: EngineConfig) -> StageResult:
        """The cells that the mapping run saw free: none without a trajectory, and none provisionally."""

        def produce(out: Path, run: RunChunks) -> None:
            trajectory = trajectory_of(read)
            if trajectory is None or self.provisional:
                return
            chunks = carve_chunks(trajectory, self.config.sensor_model, engine.registration)
            for name, array in merged(run(chunks), poses_needed(trajectory)).items():
                np.save(out / f"{name}.npy", array)

        chosen = {
            "sensor": self.config.sensor_model.to_mapping(),
            "registration": engine.registration.model_dump(mode="json"),
            "provisional": self.provisional,
        }
        return self._chunked_stage("carve_free_space", {"mesh": mesh}, chosen, produce, {"map": read})

    def build_index(
        self,
        read: StageResult,
        mesh: StageResult,
        fitted: StageResult,
        templates: StageResult,
        clusters: StageResult,
        learned: StageResult,
        carved: StageResult,
    ) -> StageResult:
        """All files of the version but what the self-test adds."""

        def produce(out: Path, run: RunChunks) -> None:
            for part in (fitted, templates, clusters, learned):
                for path in part.directory.iterdir():
                    link(path, out / path.name)
            cloud = read.directory / "points.npy"
            reaches = PROVISIONAL_REACHES if self.provisional else REACHES
            write_index_files(
                out,
                np.load(cloud) if cloud.exists() else None,
                engine_of(fitted),
                lambda positions: run(view_chunks(positions, self.config.sensor_model, reaches)),
                self._ticks("build_index"),
                provisional=self.provisional,
            )
            parts = {path.stem: np.load(path) for path in carved.directory.iterdir()}
            if parts:
                seen_free(parts, np.load(out / MAP_FILE), engine_of(fitted).registration).save(out)

        besides = {
            "map": read,
            "engine": fitted,
            "templates": templates,
            "clusters": clusters,
            "learned": learned,
            "carved": carved,
        }
        chosen = {"sensor": self.config.sensor_model.to_mapping(), "provisional": self.provisional}
        return self._chunked_stage("build_index", {"mesh": mesh}, chosen, produce, besides, VIEWS_SHARE)

    def draw_cloud(self, read: StageResult, index: StageResult) -> StageResult:
        """The map's points in levels of detail, for viewers. Of a mesh those that are seen."""

        def produce(out: Path) -> None:
            cloud = read.directory / "points.npy"
            engine = engine_of(index)
            draw_cloud(
                out,
                np.load(cloud if cloud.exists() else index.directory / MAP_FILE, mmap_mode="r"),
                Templates.load(index.directory, engine.descriptor.make()).position_m,
                trajectory_of(read),
                index.directory,
                engine.registration,
                np.load(read.directory / "T_map_level.npy"),
            )

        return self._stage("draw_cloud", {"map": read.digest, "index": index.digest}, {}, produce)

    def self_test(
        self,
        read: StageResult,
        mesh: StageResult,
        viewpoints: StageResult,
        index: StageResult,
        confirmed: Path | None = None,
    ) -> StageResult:
        """The calibration, the version's measured success, and what was left out of floor and cloud.

        Args:
            confirmed: folder of ``decode_confirmed``.
        """

        def produce(out: Path) -> None:
            results = SelfTestInputs(read, mesh, viewpoints, index, confirmed)
            write_self_test(results, self.config, self.threads, self._ticks("self_test"), self.cancelled, out)

        chosen = {
            "self_test": self.config.self_test.model_dump(mode="json"),
            "sensor": self.config.sensor_model.to_mapping(),
        }
        inputs = {"map": read, "mesh": mesh, "viewpoints": viewpoints, "index": index}
        digests = {name: result.digest for name, result in inputs.items()}
        if confirmed is not None:
            digests["confirmed"] = content_hash(confirmed)
        return self._stage("self_test", digests, chosen, produce)

    def assume_prior(self, index: StageResult) -> StageResult:
        """The calibration of a provisional version, which has no self-test: that of no map in particular."""

        def produce(out: Path) -> None:
            write_json(out / CALIBRATION_FILE, Calibration().to_mapping())
            write_json(out / BOUND_FILE, FalseAcceptBound().to_mapping())

        return self._stage("self_test", {"index": index.digest}, {"self_test": "none"}, produce)

"""The stages of a build. Each takes the results of earlier stages; the cache may already hold its own."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import final

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.catalog.manifest import SURFACE_FILE
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import ENGINE_FILE, EngineConfig
from firstfix.engine.false_accept_bound import FILE_NAME as BOUND_FILE
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.engine.index import CALIBRATION_FILE, MAP_FILE, MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.retrieval.alias_table import AliasTable
from firstfix.engine.retrieval.cascade import PROJECTION_FILE, Clusters, Templates, save_projection

from .execution.build_trace import within_a_stage
from .execution.chunks import Arrays, Chunk
from .execution.stage_cache import StageResult
from .execution.stage_runner import Progress, RunChunks, StageRunner
from .index.carve import carve_chunks, hash_of_run, merged, poses_needed, seen_free
from .index.changed_views import changed_views
from .index.cloud_octree import draw_cloud
from .index.index_files import VIEWS_SHARE, write_index_files
from .index.kept_aliases import KeptAliases
from .index.kept_free_space import carved_anew, free_before
from .index.kept_surface import KeptSurface
from .index.key_scans import KeyScans, key_scan_chunks
from .index.learn_keys import is_worth_learning, learn_keys, scans_for
from .index.views import PROVISIONAL_REACHES, REACHES, STEP_M, view_chunks
from .job.patch_source import BASE, PatchSource, is_patch_source
from .mesh.clean_cloud import voxel_means
from .mesh.places.tiled_points import TiledPoints
from .mesh.reconstruct import block_meshes, mesh_chunks
from .mesh.tiled_mesh import TiledMesh, write_tiled_mesh
from .rebuild.base_version import BaseVersion, write_made_by
from .rebuild.kept import Kept
from .self_test.compare_versions import COMPARED_FILE, ComparedVersions, compare
from .simulation.changed_surface import ChangedSurface
from .sources.patch_reader import PatchedMap
from .sources.read_map.posed_cloud import OnPosedCloud
from .sources.read_map.read_map import content_hash
from .sources.read_source import read_source
from .sources.reading import Reading
from .stage_files import link, write_json
from .stage_results import (
    POSITIONS_FILE,
    SPACING_FILE,
    FittedEngine,
    IndexedMap,
    IndexFiles,
    LevelMap,
    MapMesh,
    MapViewpoints,
    SelfTested,
)
from .templates.cluster import cluster_by_pairs, cluster_chunks, cluster_templates
from .templates.fit_engine import fit_engine
from .templates.fit_spacing import fitting_viewpoints, write_places
from .templates.linkage import Pairs
from .templates.make import template_chunks, write_templates
from .tested_version import SelfTestInputs, write_self_test
from .viewpoints.workload import Workload

THINNED_M = 0.2  # between the points of a provisional version


@final
@dataclass(frozen=True)
class BuildStages:
    """The stages of one build. Each takes the results of earlier stages and returns its own.

    Attributes:
        runner: runs a stage, or takes its result from the cache.
        threads: run the work of ``read_map`` and ``self_test``.
        provisional: make a provisional version, whose index takes less work.
        change: of the surface since the base; None: there is no base, or too much has changed.
        workload: refuses maps of too many templates before the work is begun.
    """

    runner: StageRunner
    config: BuildConfig
    threads: Executor
    provisional: bool = False
    change: ChangedSurface | None = None
    workload: Workload = field(default_factory=Workload)

    def for_config(self, config: BuildConfig, progress: Progress) -> BuildStages:
        """The stages of another build."""
        return replace(self, config=config, runner=replace(self.runner, progress=progress))

    def read_map(
        self, source: Path, trajectory: Path | None, on_posed_cloud: OnPosedCloud | None = None
    ) -> LevelMap:
        """The map in its levelled local frame, by the reader of its kind of source.

        Args:
            on_posed_cloud: see ``Reading``.
        """
        reading = Reading(
            self.runner, self.config, self.threads, self.for_config, on_posed_cloud=on_posed_cloud
        )
        return read_source(source, trajectory, reading)

    def index_map(self, read: LevelMap, base: BaseVersion | None = None) -> IndexedMap:
        """The surface of a map that was read, its viewpoints, and all that scans are localized with.

        All but the calibration, which ``self_test`` or ``assume_prior`` makes.

        Args:
            base: version whose learned keys are kept where little has changed, unless the build is exact.
        """
        mesh = self.reconstruct_mesh(read)
        after = self if base is None else self.after_change(base, mesh)
        viewpoints = after.sample_viewpoints(read, mesh)
        fitted = after.fit_engine(read, viewpoints)
        engine = fitted.engine
        templates = after.make_templates(mesh, viewpoints, engine)
        made = Templates.load(templates.directory, engine.descriptor.make())
        kept = None if base is None or self.config.exact else Kept.of(base, engine, made)
        clusters = after.cluster(templates, engine)
        learned = after.keep_keys(kept) if kept else after.learn_keys(mesh, templates, engine)
        carved = after.carve_free_space(read, mesh, engine, kept)
        index = after.build_index(read, mesh, fitted, templates, clusters, learned, carved, kept)
        return IndexedMap(mesh, viewpoints, index, kept)

    def after_change(self, base: BaseVersion, mesh: MapMesh) -> BuildStages:
        """The stages that take chunks over from a version's build if no ray meets what has changed since."""
        change = ChangedSurface.of(base.directory, mesh.directory, self.config.sensor_model.max_range_m)
        runner = replace(self.runner, chunks=replace(self.runner.chunks, change=change))
        return replace(self, runner=runner, change=change)

    def thin_map(self, read: LevelMap) -> LevelMap:
        """The map of ``read_map`` with fewer points, for a provisional version."""

        def produce(out: Path) -> None:
            for path in read.directory.iterdir():
                if not path.name.startswith("point"):
                    link(path, out / path.name)
            if not read.is_mesh:
                TiledPoints.of(voxel_means(read.points, THINNED_M)).save(out)

        return LevelMap.of(
            self.runner.stage("read_map", {"map": read.digest}, {"thinned_m": THINNED_M}, produce)
        )

    def reconstruct_mesh(self, read: LevelMap) -> MapMesh:
        """The surface of the map, in tiles. A source that is a mesh stays as it is."""

        def produce(out: Path, run: RunChunks) -> None:
            if read.is_mesh:  # it is taken as it is
                for path in read.directory.iterdir():
                    link(path, out / path.name)
            else:
                points, trajectory = read.points, read.trajectory
                self.workload.check_cloud(points, trajectory, self.config.viewpoints)
                chunks = mesh_chunks(points, trajectory, self.config.surface)
                write_tiled_mesh(block_meshes(run(chunks)), out)

        return MapMesh.of(
            self.runner.chunked_stage("reconstruct_mesh", {"map": read}, self.config.surface, produce)
        )

    def sample_viewpoints(self, read: LevelMap, mesh: MapMesh) -> MapViewpoints:
        """The sensor positions of the templates, and how far one sees from them."""
        name, inputs = "sample_viewpoints", {"map": read.digest, "mesh": mesh.digest}
        chosen = {
            "viewpoints": self.config.viewpoints.model_dump(mode="json"),
            "sensor": self.config.sensor_model.to_mapping(),
        }

        def run(chunks: Sequence[Chunk], **places: StageResult) -> Iterator[Arrays]:
            reads = {"map": read, "mesh": mesh, **places}
            return self.runner.chunks.run(name, chunks, reads, self.runner.ticks(name), self.runner.cancelled)

        def places_at(spacing_m: float) -> StageResult:
            def produce(out: Path) -> None:
                config, sensor = self.config.viewpoints, self.config.sensor_model
                tiled = TiledMesh.load(mesh.directory)
                self.workload.check_mesh(tiled, read.trajectory, config, spacing_m)
                write_places(run, read.directory, mesh.directory, config, spacing_m, sensor, out)

            with within_a_stage():
                return self.runner.cache.run(name, inputs, {**chosen, "places_m": spacing_m}, produce)

        def produce(out: Path) -> None:
            fitting_viewpoints(
                places_at,
                lambda places, chunks: run(chunks, places=places),
                self.config.viewpoints,
                self.config.sensor_model,
                out,
            )
            found = np.load(out / POSITIONS_FILE, mmap_mode="r")
            self.workload.check_found(len(found), float(np.load(out / SPACING_FILE)))

        return MapViewpoints.of(self.runner.stage(name, inputs, chosen, produce))

    def fit_engine(self, read: LevelMap, viewpoints: MapViewpoints) -> FittedEngine:
        """The engine's parameters: what the version is made with and asked with."""

        def produce(out: Path) -> None:
            engine = fit_engine(
                self.config.engine,
                self.config.sensor_model,
                STEP_M if read.is_mesh else read.spacing_m,
                viewpoints.view_m,
                viewpoints.spacing_m,
                read.T_map_level,
            )
            (out / ENGINE_FILE).write_text(engine.model_dump_json())

        chosen = {
            "sensor": self.config.sensor_model.to_mapping(),
            "engine": self.config.engine.model_dump(mode="json"),
        }
        return FittedEngine.of(
            self.runner.stage(
                "fit_engine", {"map": read.digest, "viewpoints": viewpoints.digest}, chosen, produce
            )
        )

    def make_templates(self, mesh: MapMesh, viewpoints: MapViewpoints, engine: EngineConfig) -> StageResult:
        """The templates: simulated scans at the viewpoints, described."""

        def produce(out: Path, run: RunChunks) -> None:
            positions = viewpoints.positions
            chunks = template_chunks(
                positions,
                viewpoints.chunk_start,
                self.config.viewpoints.tile_m,
                viewpoints.spacing_m,
                self.config.sensor_model.coarser(self.config.simulate.max_rays),
                engine.descriptor,
            )
            write_templates(run(chunks), len(positions), out)

        chosen = {
            "sensor": self.config.sensor_model.to_mapping(),
            "simulate": self.config.simulate.model_dump(mode="json"),
            "descriptor": engine.descriptor.model_dump(mode="json"),
        }
        return self.runner.chunked_stage(
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
                    self.runner.ticks("cluster"),
                    self.runner.cancelled,
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
        return self.runner.chunked_stage("cluster", {"templates": templates}, chosen, produce)

    def learn_keys(self, mesh: MapMesh, templates: StageResult, engine: EngineConfig) -> StageResult:
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
        return self.runner.chunked_stage(
            "learn_keys", {"mesh": mesh}, chosen, produce, {"templates": templates}
        )

    def keep_keys(self, kept: Kept) -> StageResult:
        """The projection of the keys of the version before; nothing where it has none."""
        path = kept.base.directory / PROJECTION_FILE

        def produce(out: Path) -> None:
            if path.exists():
                link(path, out / path.name)

        return self.runner.stage("learn_keys", {"base": kept.base.digest}, {"kept": True}, produce)

    def carve_free_space(
        self, read: LevelMap, mesh: MapMesh, engine: EngineConfig, kept: Kept | None = None
    ) -> StageResult:
        """The cells that the mapping run saw free: none without a trajectory, and none provisionally.

        Args:
            kept: what the version has of the one before: of the same mapping run, cells are carved anew where
                the surface has changed.
        """
        sensor, registration = self.config.sensor_model, engine.registration

        def produce(out: Path, run: RunChunks) -> None:
            trajectory = read.trajectory
            if trajectory is None or self.provisional:
                return
            before = None if kept is None else free_before(kept.base, trajectory)
            if before is not None and self.change is not None:
                check = partial(self.runner.check_wanted, "carve_free_space")
                free = carved_anew(
                    before, trajectory, sensor, registration, self.change, mesh.directory, check
                )
            else:
                free = merged(run(carve_chunks(trajectory, sensor, registration)), poses_needed(trajectory))
            for name, array in free.items():
                np.save(out / f"{name}.npy", array)

        chosen = {
            "sensor": sensor.to_mapping(),
            "registration": registration.model_dump(mode="json"),
            "provisional": self.provisional,
            "base": None if kept is None else kept.base.digest,
        }
        return self.runner.chunked_stage("carve_free_space", {"mesh": mesh}, chosen, produce, {"map": read})

    def build_index(
        self,
        read: LevelMap,
        mesh: MapMesh,
        fitted: FittedEngine,
        templates: StageResult,
        clusters: StageResult,
        learned: StageResult,
        carved: StageResult,
        kept: Kept | None = None,
    ) -> IndexFiles:
        """All files of the version but what the self-test adds.

        Args:
            kept: what the version has of the one before: known aliases are renewed where it has changed.
        """

        def produce(out: Path, run: RunChunks) -> None:
            for part in (fitted, templates, clusters, learned):
                for path in part.directory.iterdir():
                    link(path, out / path.name)
            reaches = PROVISIONAL_REACHES if self.provisional else REACHES
            sensor, surface = self.config.sensor_model, self._kept_surface(kept)

            def look(positions: NDArray[np.floating]) -> Iterator[Arrays]:
                if surface is None:
                    return run(view_chunks(positions, sensor, reaches))
                check = partial(self.runner.check_wanted, "build_index")
                return changed_views(positions, surface, sensor, mesh.directory, check)

            write_index_files(
                out,
                None if read.is_mesh else read.points,
                fitted.engine,
                look,
                self.runner.ticks("build_index"),
                provisional=self.provisional,
                kept=None if kept is None else _kept_aliases(kept),
                kept_surface=surface,
                made_of=partial(self.runner.chunks.made_of, "build_index"),
            )
            if not self.provisional:  # for the build of the next version
                link(mesh.directory / SURFACE_FILE, out / SURFACE_FILE)
                write_made_by(out, hash_of_run(read.trajectory))
            parts = {path.stem: np.load(path) for path in carved.directory.iterdir()}
            if parts:
                seen_free(parts, np.load(out / MAP_FILE), fitted.engine.registration).save(out)

        besides = {
            "map": read,
            "engine": fitted,
            "templates": templates,
            "clusters": clusters,
            "learned": learned,
            "carved": carved,
        }
        chosen = {
            "sensor": self.config.sensor_model.to_mapping(),
            "provisional": self.provisional,
            "base": None if kept is None else kept.base.digest,
        }
        return IndexFiles.of(
            self.runner.chunked_stage("build_index", {"mesh": mesh}, chosen, produce, besides, VIEWS_SHARE)
        )

    def _kept_surface(self, kept: Kept | None) -> KeptSurface | None:
        """The surface of the version before; None: it is made anew."""
        if kept is None or self.change is None:
            return None
        return KeptSurface.load(kept.base, self.change)

    def draw_cloud(self, read: LevelMap, index: IndexFiles) -> StageResult:
        """The map's points in levels of detail, for viewers. Of a mesh those that are seen."""

        def produce(out: Path) -> None:
            engine = index.engine
            draw_cloud(
                out,
                None if read.is_mesh else read.mapped_points,
                Templates.load(index.directory, engine.descriptor.make()).position_m,
                read.trajectory,
                index.directory,
                engine.registration,
                read.T_map_level,
                None if read.is_mesh else read.intensity,
                partial(self.runner.chunks.made_of, "draw_cloud"),
            )

        return self.runner.stage("draw_cloud", {"map": read.digest, "index": index.digest}, {}, produce)

    def self_test(
        self,
        read: LevelMap,
        mesh: MapMesh,
        viewpoints: MapViewpoints,
        index: IndexFiles,
        confirmed: Path | None = None,
        kept: Kept | None = None,
    ) -> SelfTested:
        """The calibration, the version's measured success, and what was left out of floor and cloud.

        Args:
            confirmed: folder of ``decode_confirmed``.
            kept: what the index has of the version before, whose calibration is kept if it holds.
        """

        def produce(out: Path) -> None:
            results = SelfTestInputs(read, mesh, viewpoints, index, confirmed, kept)
            write_self_test(
                results, self.config, self.threads, self.runner.ticks("self_test"), self.runner.cancelled, out
            )

        chosen = {
            "self_test": self.config.self_test.model_dump(mode="json"),
            "activate": self.config.activate.model_dump(mode="json"),
            "sensor": self.config.sensor_model.to_mapping(),
        }
        inputs = {"map": read, "mesh": mesh, "viewpoints": viewpoints, "index": index}
        digests = {name: result.digest for name, result in inputs.items()}
        if confirmed is not None:
            digests["confirmed"] = content_hash(confirmed)
        if kept is not None:
            digests["base"] = kept.base.digest
        return SelfTested.of(self.runner.stage("self_test", digests, chosen, produce))

    def assume_prior(self, index: IndexFiles) -> SelfTested:
        """The calibration of a provisional version, which has no self-test: that of no map in particular."""

        def produce(out: Path) -> None:
            write_json(out / CALIBRATION_FILE, Calibration().to_mapping())
            write_json(out / BOUND_FILE, FalseAcceptBound().to_mapping())

        return SelfTested.of(
            self.runner.stage("self_test", {"index": index.digest}, {"self_test": "none"}, produce)
        )

    def compare_patch(
        self, source: Path, read: LevelMap, mesh: MapMesh, index: IndexFiles, tested: SelfTested
    ) -> ComparedVersions | None:
        """Answers of the patched version and of the one before at unchanged places; None: it is no patch."""
        if not is_patch_source(source):
            return None
        patched = PatchedMap.of(read)

        def produce(out: Path) -> None:
            found = compare(
                Localizer(MapIndex.load(source / BASE), explains=False),
                Localizer(index.load(tested.calibration), explains=False),
                mesh.simulator,
                self.config.sensor_model,
                self.config.self_test,
                patched.changed_cells,
                self.threads,
                self.runner.cancelled,
            )
            (out / COMPARED_FILE).write_text(json.dumps(found.to_mapping()))

        inputs = {"map": read.digest, "mesh": mesh.digest, "index": index.digest, "tested": tested.digest}
        chosen = {
            "compared_with": PatchSource.load(source).base,
            "self_test": self.config.self_test.model_dump(mode="json"),
        }
        return ComparedVersions.of(self.runner.stage("self_test", inputs, chosen, produce))


def _kept_aliases(kept: Kept) -> KeptAliases | None:
    """The aliases of the version before; None: it has none."""
    before = AliasTable.load(kept.base.directory, len(kept.base.templates))
    return None if before is None else KeptAliases(before, kept.changed.row_before)

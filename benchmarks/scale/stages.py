"""The stages of a build, so that a million templates survive an interruption, and each with its cost."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig
from firstfix.descriptor import Descriptor
from firstfix.engine.config import EngineConfig
from firstfix.engine.retrieval.clusters import Clusters
from firstfix.engine.retrieval.templates import Templates
from firstfix.sensor import SensorModel
from firstfix_builder.build_stages import BuildStages
from firstfix_builder.execution.chunk_cache import ChunkCache
from firstfix_builder.execution.local_executor import LocalExecutor
from firstfix_builder.execution.stage_cache import StageCache, StageResult
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.tiled_mesh import TiledMesh
from firstfix_builder.simulation.rays import Rays
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.stage_files import simulator_of
from firstfix_builder.templates.fit_spacing import sample_fitting_viewpoints
from firstfix_builder.templates.make import SCANS_AT_ONCE, described_views

from .spent import spent

PART = 16_384  # templates, of one stage
LASTING_VERSION = "2"  # raise it when what templates are made of, or how, is another
LASTING = ("read_map", "reconstruct_mesh", "sample_viewpoints", "make_templates_part", "make_templates")

Cost = dict[str, float]


@dataclass(frozen=True)
class ScaleStages(BuildStages):
    """A build's stages, each in this process alone and with what it took.

    Attributes:
        lasting: templates and what they are made of are kept here from one program to the next, all
            other stages are made anew by another program.
        costs: where the costs are kept.
        took: by stage, of those asked for so far.
    """

    lasting: StageCache
    costs: Path
    took: dict[str, Cost] = field(default_factory=dict)

    @classmethod
    def below(cls, work: Path, name: str, config: BuildConfig, threads: ThreadPoolExecutor) -> ScaleStages:
        """Returns the stages of a world. They run in one process, whose memory is that of the build."""
        costs = work / "costs" / name
        costs.mkdir(parents=True, exist_ok=True)
        cache = StageCache(work)
        return cls(
            cache,
            ChunkCache(cache, LocalExecutor(work, threads, threads)),
            lambda stage, fraction: None,
            lambda: False,
            config,
            threads,
            StageCache(work / "lasting", code_version=LASTING_VERSION),
            costs,
        )

    def reconstruct_mesh(self, read: StageResult) -> StageResult:
        """The source is a mesh: taken as it is."""

        def produce(out: Path) -> None:
            TiledMesh.of(Mesh.load(read.directory)).save(out)

        return self._stage("reconstruct_mesh", {"map": read.digest}, self._plain("reconstruct"), produce)

    def sample_viewpoints(self, read: StageResult, mesh: StageResult) -> StageResult:
        """In whatever order they come."""

        def produce(out: Path) -> None:
            found, spacing_m = sample_fitting_viewpoints(
                simulator_of(mesh),
                self.config.viewpoints,
                self.config.sensor_model,
                np.load(read.directory / "trajectory.npy"),
            )
            np.save(out / "positions.npy", found.positions)
            np.save(out / "floor_z.npy", found.floor_z)
            np.save(out / "spacing_m.npy", spacing_m)

        chosen = {"viewpoints": self._plain("viewpoints"), "sensor": self.config.sensor_model.to_mapping()}
        return self._stage("sample_viewpoints", {"map": read.digest, "mesh": mesh.digest}, chosen, produce)

    def make_templates(self, mesh: StageResult, viewpoints: StageResult, engine: EngineConfig) -> StageResult:
        """In parts, each a stage."""
        positions = np.load(viewpoints.directory / "positions.npy")
        height_m = positions[:, 2] - np.load(viewpoints.directory / "floor_z.npy")
        sensor = self.config.sensor_model.coarser(self.config.simulate.max_rays)
        descriptor = engine.descriptor.make()
        chosen = {"sensor": sensor.to_mapping(), "descriptor": engine.descriptor.model_dump(mode="json")}
        simulators: list[Simulator] = []

        def part(start: int) -> StageResult:
            here = slice(start, start + PART)

            def produce(out: Path) -> None:
                if not simulators:
                    simulators.append(simulator_of(mesh))
                made = _simulated(simulators[0], positions[here], height_m[here], sensor, descriptor)
                made.save(out)

            inputs = {
                "mesh": mesh.digest,
                "positions": hashlib.sha256(positions[here].tobytes()).hexdigest(),
                "height_m": hashlib.sha256(height_m[here].tobytes()).hexdigest(),
            }
            print(f"templates from {start} of {len(positions)}", file=sys.stderr, flush=True)
            return self._stage("make_templates_part", inputs, chosen, produce)

        parts, each = [], []
        for start in range(0, len(positions), PART):
            parts.append(part(start))
            each.append(self.took.pop("make_templates_part"))

        def produce(out: Path) -> None:
            Templates.concatenate([Templates.load(one.directory, descriptor) for one in parts]).save(out)

        whole = self._stage(
            "make_templates", {str(number): one.digest for number, one in enumerate(parts)}, chosen, produce
        )
        each.append(self.took["make_templates"])
        self.took["make_templates"] = {
            "seconds": round(sum(cost["seconds"] for cost in each), 1),
            "cpu_seconds": round(sum(cost["cpu_seconds"] for cost in each), 1),
            "peak_mb": max(cost["peak_mb"] for cost in each),
        }
        return whole

    def cluster(self, templates: StageResult, engine: EngineConfig) -> StageResult:
        """Puts every template into a cluster of its own, as the default method does."""

        def produce(out: Path) -> None:
            Clusters.alone(len(np.load(templates.directory / "template_height_m.npy", "r"))).save(out)

        return self._stage("cluster", {"templates": templates.digest}, {}, produce)

    def _plain(self, part: str) -> dict[str, Any]:
        """A part of the config, but for the tiles that say in which order templates stand."""
        return {name: value for name, value in self.config.to_mapping()[part].items() if name != "tile_m"}

    def _stage(
        self, name: str, inputs: Mapping[str, str], config: Any, produce: Callable[[Path], None]
    ) -> StageResult:
        now = self.costs / f".{name}.json"

        def measured(out: Path) -> None:
            with spent(now):
                produce(out)

        result = (self.lasting if name in LASTING else self.cache).run(name, inputs, config, measured)
        cost = self.costs / f"{name}-{result.digest}.json"
        if now.exists():
            now.replace(cost)
        self.took[name] = json.loads(cost.read_text())
        return result


def _simulated(
    simulator: Simulator,
    positions: NDArray[np.float64],
    height_m: NDArray[np.float64],
    sensor: SensorModel,
    descriptor: Descriptor,
) -> Templates:
    """Templates at (n, 3) positions, (n,) above their floors."""
    rays = Rays.at_any_heading(sensor)
    made = []
    for start in range(0, len(positions), SCANS_AT_ONCE):
        here = slice(start, start + SCANS_AT_ONCE)
        seen = described_views(simulator, sensor, rays, positions[here], height_m[here], descriptor)
        made.append(Templates(positions[here].astype(np.float32), height_m[here].astype(np.float32), seen))
    return Templates.concatenate(made)

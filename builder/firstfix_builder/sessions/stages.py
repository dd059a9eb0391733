"""The stages of a build whose source may be several sessions of one place."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.builds.config import BuildConfig, LearnKeysConfig, SelfTestConfig, ViewpointConfig
from firstfix.builds.options import STAGES
from firstfix.engine.calibration import Calibration
from firstfix.engine.index import MAP_FILE, MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildFailed, InputError, InvalidOption, MalformedData, NotFound
from firstfix.transform import inverse, transform_points

from ..build_stages import BuildStages
from ..execution.build_trace import within_a_stage
from ..execution.stage_cache import StageResult
from ..mesh.clean_cloud import clean_cloud
from ..mesh.level import level_frame
from ..mesh.places.tiled_points import TiledPoints
from ..simulation.simulate import Simulator
from ..sources.check_map.check_map import check_map
from ..sources.read_map.archive import SUFFIX, unpack
from ..sources.read_map.map_data import MapData
from ..sources.read_map.read_map import content_hash
from ..stage_files import link, simulator_of, trajectory_of, write_findings
from .description import Session, description_in, read_description
from .merge import ReadSession, merge
from .session_map import SessionMap

SESSIONS_FILE = "sessions.json"
NEAR_TRAJECTORY_M = 5.0  # distance from the trajectory within which a session is mapped well


@dataclass(frozen=True)
class SessionStages(BuildStages):
    """The stages of a build. The first one merges the sessions of the source, if it has several."""

    def read_map(self, source: Path, trajectory: Path | None) -> StageResult:
        """The map: of one file or folder, of the sessions in a folder, or of an archive of a folder."""
        if source.suffix.lower() == SUFFIX and source.is_file():
            return self._unpacked(source, trajectory)
        described = description_in(source) if source.is_dir() else None
        if described is None:
            return super().read_map(source, trajectory)
        if trajectory is not None:
            raise InvalidOption(f"give the trajectories of several sessions in {described.name}")

        def produce(out: Path) -> None:
            with within_a_stage():
                self._merge(source, read_description(described), out)

        return self._stage("read_map", {"source": content_hash(source)}, self._chosen("sessions"), produce)

    def _unpacked(self, archive: Path, trajectory: Path | None) -> StageResult:
        """The map of an archive, which is unpacked and read like a folder."""

        def produce(out: Path) -> None:
            folder = unpack(archive, out.parent / "unpacked")  # removed when the stage is done
            with within_a_stage():
                read = self.read_map(folder, trajectory)
            for path in read.directory.iterdir():
                link(path, out / path.name)

        inputs = {"source": content_hash(archive)}
        if trajectory is not None:
            inputs["trajectory"] = content_hash(trajectory)
        names = "" if trajectory is None else trajectory.name
        chosen = self._chosen(f"archive {names}") | {"held_out": self.config.self_test.held_out}
        return self._stage("read_map", inputs, chosen, produce)

    def _chosen(self, of: str) -> dict[str, Any]:
        return {
            "axis": self.config.axis,
            "scale": self.config.scale,
            "level": self.config.level,
            "clean": self.config.clean.model_dump(mode="json"),
            "of": of,
        }

    def _merge(self, source: Path, sessions: tuple[Session, ...], out: Path) -> None:
        lean = self._alignment_only()
        results = [_result(lean, source, session) for session in sessions]
        steps = _Steps(2 * len(sessions), self._ticks("read_map"))  # each session is indexed and placed

        @cache
        def map_of(number: int) -> SessionMap:
            name = sessions[number].source
            with _naming(name):
                found = _map_of(replace(lean, progress=steps.within), name, results[number])
            steps.next()
            return found

        @cache
        def mesh_of(number: int) -> Simulator:
            with _naming(sessions[number].source):
                return simulator_of(lean.reconstruct_mesh(results[number]))

        read = [_read(session, result) for session, result in zip(sessions, results, strict=True)]
        merged = merge(read, map_of, mesh_of, self.threads, steps.next, self.cancelled)
        T_first_level = level_frame(merged.points) if self.config.level else np.eye(4)
        T_level_first = inverse(T_first_level)
        points = transform_points(T_level_first, merged.points)
        TiledPoints.of(clean_cloud(points, self.config.clean)).save(out)
        write_findings(check_map(MapData(points=merged.points)), out)
        if merged.trajectory is not None:
            np.save(out / "trajectory.npy", T_level_first @ merged.trajectory)
        np.save(out / "T_map_level.npy", merged.T_map_first @ T_first_level)
        (out / SESSIONS_FILE).write_text(json.dumps(merged.record, sort_keys=True, indent=1) + "\n")

    def _alignment_only(self) -> SessionStages:
        """The stages that make the index of one session, reduced to what its alignment needs.

        The sensor and the spacing are always the same, so that a build for another sensor reuses the
        transforms.
        """
        config = BuildConfig(
            axis=self.config.axis,
            scale=self.config.scale,
            level=self.config.level,
            clean=self.config.clean,
            viewpoints=ViewpointConfig(max_distance_to_trajectory_m=NEAR_TRAJECTORY_M),
            learn_keys=LearnKeysConfig(scans=0),
            self_test=SelfTestConfig(held_out=0),  # real scans of sessions are not asked
        )
        return replace(self, config=config, progress=lambda stage, fraction: None)


class _Steps:
    """Progress of a stage that runs other stages several times."""

    def __init__(self, count: int, progress: Callable[[float], None]) -> None:
        self._count, self._progress, self._done = count, progress, 0

    def within(self, stage: str, fraction: float) -> None:
        """Reports the progress of the current step."""
        done = self._done + (STAGES.index(stage) + fraction) / len(STAGES)
        self._progress(min(done / self._count, 1.0))

    def next(self) -> None:
        """Ends the step."""
        self._done += 1
        self._progress(min(self._done / self._count, 1.0))


def _result(lean: SessionStages, source: Path, session: Session) -> StageResult:
    """The session's own map."""
    trajectory = None if session.trajectory is None else source / session.trajectory
    with _naming(session.source):
        result = BuildStages.read_map(lean, source / session.source, trajectory)
        if not (result.directory / "points.npy").exists():
            raise MalformedData("it is a mesh, and only clouds can be merged")
    return result


@contextmanager
def _naming(session: str) -> Iterator[None]:
    """Puts the session's name before the reason why it cannot be read or indexed."""
    try:
        yield
    except (InputError, NotFound, BuildFailed) as error:
        raise type(error)(f"session {session}: {error}") from error


def _read(session: Session, result: StageResult) -> ReadSession:
    return ReadSession(
        session,
        np.load(result.directory / "points.npy"),
        trajectory_of(result),
        np.load(result.directory / "T_map_level.npy"),
    )


def _map_of(lean: SessionStages, name: str, read: StageResult) -> SessionMap:
    mesh, _, index = lean.index_map(read)
    return SessionMap.of(
        name,
        simulator_of(mesh),
        lean.config.sensor_model,
        np.load(index.directory / MAP_FILE),
        Localizer(MapIndex.load(index.directory, Calibration()), explains=False),
    )

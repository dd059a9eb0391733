"""The reader of several sessions of one place, in a folder that lists them: they are merged to one map."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np

from firstfix.builds.config import BuildConfig, LearnKeysConfig, SelfTestConfig, ViewpointConfig
from firstfix.builds.options import STAGES
from firstfix.engine.calibration import Calibration
from firstfix.engine.localizer import Localizer
from firstfix.errors import BuildFailed, InputError, InvalidOption, MalformedData, NotFound
from firstfix.transform import inverse, transform_points

from ..execution.build_trace import within_a_stage
from ..mesh.clean_cloud import clean_cloud
from ..mesh.intensity import as_column, from_column
from ..mesh.level import level_frame
from ..simulation.simulate import Simulator
from ..stage_files import TRAJECTORY_FILE
from ..stage_results import SESSIONS_FILE, T_MAP_LEVEL_FILE, LevelMap
from .check_map.check_map import check_map
from .read_map.map_data import MapData
from .reading import Reading
from .sessions.description import Session, description_in, read_description
from .sessions.merge import ReadSession, merge
from .sessions.session_map import SessionMap
from .write_level_map import write_cloud, write_findings

NEAR_TRAJECTORY_M = 5.0  # distance from the trajectory within which a session is mapped well


class SessionsReader:
    """Reads a folder with a ``sessions.yaml``."""

    def can_read(self, path: Path) -> bool:
        """Whether a folder lists sessions."""
        return path.is_dir() and description_in(path) is not None

    def read(self, path: Path, trajectory: Path | None, reading: Reading) -> LevelMap:
        """The map of all sessions.

        Raises:
            BuildFailed: a session cannot be placed.
        """
        described = description_in(path)
        if described is None:
            raise NotFound(f"{path.name}: it lists no sessions")
        if trajectory is not None:
            raise InvalidOption(f"give the trajectories of several sessions in {described.name}")

        def produce(out: Path) -> None:
            with within_a_stage():
                _merge(path, read_description(described), reading, out)

        return reading.stage(path, None, produce)


def _merge(source: Path, sessions: Sequence[Session], reading: Reading, out: Path) -> None:
    config = _alignment_only(reading.config)
    lean = reading.with_config(config)
    results = [_result(source, session, lean) for session in sessions]
    steps = _Steps(2 * len(sessions), reading.runner.ticks("read_map"))  # each is indexed and placed

    @cache
    def map_of(number: int) -> SessionMap:
        name = sessions[number].source
        with _naming(name):
            found = _map_of(reading, config, steps.within, name, results[number])
        steps.next()
        return found

    @cache
    def mesh_of(number: int) -> Simulator:
        with _naming(sessions[number].source):
            stages = reading.stages_for(config, lean.runner.progress)
            return stages.reconstruct_mesh(results[number]).simulator

    read = [_read(session, result) for session, result in zip(sessions, results, strict=True)]
    merged = merge(read, map_of, mesh_of, reading.threads, steps.next, reading.runner.cancelled)
    T_first_level = level_frame(merged.points) if reading.config.level else np.eye(4)
    T_level_first = inverse(T_first_level)
    rows = as_column(transform_points(T_level_first, merged.points), merged.intensity)
    write_cloud(*from_column(clean_cloud(rows, reading.config.clean), merged.intensity), out)
    write_findings(check_map(MapData(points=merged.points)), out)
    if merged.trajectory is not None:
        np.save(out / TRAJECTORY_FILE, T_level_first @ merged.trajectory)
    np.save(out / T_MAP_LEVEL_FILE, merged.T_map_first @ T_first_level)
    (out / SESSIONS_FILE).write_text(json.dumps(merged.record, sort_keys=True, indent=1) + "\n")


def _alignment_only(config: BuildConfig) -> BuildConfig:
    """The config of the index of one session, reduced to what its alignment needs.

    The sensor and the spacing are always the same, so that a build for another sensor reuses the transforms.
    """
    return BuildConfig(
        axis=config.axis,
        scale=config.scale,
        level=config.level,
        clean=config.clean,
        viewpoints=ViewpointConfig(max_distance_to_trajectory_m=NEAR_TRAJECTORY_M),
        learn_keys=LearnKeysConfig(scans=0),
        self_test=SelfTestConfig(held_out=0),  # real scans of sessions are not asked
    )


class _Steps:
    """Progress of a stage that runs other stages several times."""

    def __init__(self, count: int, progress: Callable[[float], None]) -> None:
        self._count, self._progress, self._done = count, progress, 0

    def within(self, stage: str, fraction: float) -> None:
        """Report the progress of the current step."""
        done = self._done + (STAGES.index(stage) + fraction) / len(STAGES)
        self._progress(min(done / self._count, 1.0))

    def next(self) -> None:
        """End the step."""
        self._done += 1
        self._progress(min(self._done / self._count, 1.0))


def _result(source: Path, session: Session, lean: Reading) -> LevelMap:
    """The session's own map."""
    trajectory = None if session.trajectory is None else source / session.trajectory
    with _naming(session.source):
        result = lean.within(source / session.source, trajectory)
        if result.is_mesh:
            raise MalformedData("it is a mesh, and only clouds can be merged")
    return result


@contextmanager
def _naming(session: str) -> Iterator[None]:
    """Put the session's name before the reason why it cannot be read or indexed."""
    try:
        yield
    except (InputError, NotFound, BuildFailed) as error:
        raise type(error)(f"session {session}: {error}") from error


def _read(session: Session, result: LevelMap) -> ReadSession:
    return ReadSession(session, result.points, result.trajectory, result.T_map_level, result.intensity)


def _map_of(
    reading: Reading, config: BuildConfig, progress: Callable[[str, float], None], name: str, read: LevelMap
) -> SessionMap:
    made = reading.stages_for(config, progress).index_map(read)
    return SessionMap.of(
        name,
        made.mesh.simulator,
        config.sensor_model,
        made.index.map_points,
        Localizer(made.index.load(Calibration()), explains=False),
    )

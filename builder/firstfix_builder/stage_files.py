"""The files of stages in their folders: written by one stage, read by later ones."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.config import EngineConfig
from firstfix.findings.finding import Finding

from .execution.stage_cache import StageResult
from .index.views import STEP_M
from .mesh.clean_cloud import point_spacing_m
from .self_test.localizability import SeenFloor
from .simulation.local_simulator import whole_simulator
from .simulation.simulate import Simulator
from .templates.fit_spacing import FLOOR_FILE, LEFT_OUT_FILE

MOVING_FILE = "moving.json"
FINDINGS_FILE = "findings.json"


def trajectory_of(read: StageResult) -> NDArray[np.float64] | None:
    """(m, 4, 4) poses of the mapping run in the level frame, or None if the map has none."""
    path = read.directory / "trajectory.npy"
    return np.load(path) if path.exists() else None


def spacing_m_of(read: StageResult) -> float:
    """Spacing of the map's points."""
    path = read.directory / "points.npy"
    return point_spacing_m(np.load(path)) if path.exists() else STEP_M


def simulator_of(mesh: StageResult) -> Simulator:
    """A simulator over the whole mesh."""
    return whole_simulator(mesh.directory)


def floor_of(viewpoints: StageResult) -> SeenFloor | None:
    """The floor that the mapping run saw, or None if the map has no trajectory."""
    path = viewpoints.directory / FLOOR_FILE
    if not path.exists():
        return None
    return SeenFloor(**json.loads(path.read_text()), left_out=np.load(viewpoints.directory / LEFT_OUT_FILE))


def findings_of(read: StageResult) -> list[dict[str, Any]]:
    """Findings of the map that was read, as JSON values."""
    found: list[dict[str, Any]] = json.loads((read.directory / FINDINGS_FILE).read_text())
    return found


def write_findings(findings: Sequence[Finding], out: Path) -> None:
    """Writes the findings of a map for ``findings_of``."""
    (out / FINDINGS_FILE).write_text(json.dumps([one.to_mapping() for one in findings]) + "\n")


def moving_of(read: StageResult) -> dict[str, Any] | None:
    """Returns the figures of ``without_moving``, or None if the map brought no mapping scans."""
    path = read.directory / MOVING_FILE
    return json.loads(path.read_text()) if path.exists() else None


def engine_of(fitted: StageResult) -> EngineConfig:
    """The engine's parameters that ``fit_engine`` chose."""
    return EngineConfig.load(fitted.directory)


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Writes values by name as a file of a version."""
    path.write_text(json.dumps(value, sort_keys=True, indent=1) + "\n")


def link(source: Path, target: Path) -> None:
    """Links a file, or copies it where the file system cannot link."""
    try:
        target.hardlink_to(source)
    except OSError:  # another file system
        shutil.copyfile(source, target)

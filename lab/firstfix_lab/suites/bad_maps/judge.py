"""Judgement of a map: by its check alone, which takes seconds, or by a whole build and the gate."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix.catalog.hold_back import reason_to_hold
from firstfix.catalog.version_findings import findings_of
from firstfix.errors import FirstfixError
from firstfix.findings.finding import Finding, Severity
from firstfix.findings.registry import KINDS
from firstfix_builder.pipeline import build_version
from firstfix_builder.sources.check_map.check_map import check_map
from firstfix_builder.sources.read_map.map_data import MapData, local_origin, subtract_origin

from .cases import MapCase
from .places import place_map

REFUSED, HELD, WARNED, PASSED = "refused", "held back", "warned", "passed"


@dataclass(frozen=True)
class Judged:
    """Outcome of one map.

    Attributes:
        outcome: REFUSED, HELD, WARNED or PASSED.
        codes: of its findings, the reason to hold it back last.
        cpu_s: processor time of this process.
        points: of the map.
        found, localized: shares of the self-test's scans; None: there was none.
        why: it is refused or held back, in words.
    """

    case: MapCase
    outcome: str
    codes: tuple[str, ...]
    cpu_s: float
    points: int
    found: float | None = None
    localized: float | None = None
    why: str = ""


def by_check(case: MapCase) -> Judged:
    """Run the check of the map."""
    made = case.change(place_map(case.place))
    start = time.process_time()
    poses = made.poses if len(made.poses) else None
    data = MapData(points=made.points, trajectory=poses, trajectory_source="given")
    local = subtract_origin(data, local_origin(data))
    found = check_map(local, local.trajectory)
    return Judged(case, _outcome(found), _codes(found), time.process_time() - start, len(made.points))


def by_build(case: MapCase, folder: Path) -> Judged:
    """Build the map, and ask whether its version would be activated."""
    made = case.change(place_map(case.place))
    folder.mkdir(parents=True)
    np.save(folder / "map.npy", made.points)
    poses = folder / "poses.txt"
    np.savetxt(poses, made.poses[:, :3].reshape(-1, 12))
    given = poses if len(made.poses) else None
    config = BuildConfig.parse({**made.config, **(case.config or {})})
    start = time.process_time()
    try:
        manifest = build_version(folder / "map.npy", config, folder / "work", trajectory=given).manifest
    except FirstfixError as error:
        return Judged(
            case, REFUSED, (error.code,), time.process_time() - start, len(made.points), why=str(error)
        )
    found = findings_of(manifest)
    held = reason_to_hold(case.place, manifest, None, config.activate, "propose")
    tested = manifest.self_test
    return Judged(
        case,
        HELD if held else _outcome(found),
        _codes(found) if held is None else (*_codes(found), held.code),
        time.process_time() - start,
        len(made.points),
        tested.get("found"),
        tested.get("localized"),
        held.text if held else "",
    )


def _outcome(found: Sequence[Finding]) -> str:
    if any(one.severity is Severity.ERROR for one in found):
        return REFUSED
    if any(KINDS[one.code].holds_back for one in found):
        return HELD
    return WARNED if found else PASSED


def _codes(found: Sequence[Finding]) -> tuple[str, ...]:
    return tuple(one.code for one in found)

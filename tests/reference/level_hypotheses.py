"""Ways to level a scan that are worth a search, in NumPy: ``native.level_hypotheses`` is held against it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.preprocess import PreparedQuery, PreparedScan
from firstfix.engine.registration.surface import Surface
from firstfix.scan.levelling import levelling_rotation
from tests.reference.levelled_otherwise import with_up

TILT_DEG = 5.0
TILTS = 6
_APART_COSINE = np.cos(np.radians(2.0))  # of two ups that are worth two searches
_APART_M = 0.25  # of two heights
_MAX_LEVELLED = 18  # each has a descriptor and a key search of its own
_GROUND_WITHIN_M = 10.0
_GROUND_COSINE = 0.8  # of the ground's normals with up, at least
_MIN_GROUND = 20  # points


def level_hypotheses(
    prepared: PreparedQuery, expected_up: NDArray[np.float64] | None, usual_height_m: float, *, tilted: bool
) -> tuple[PreparedScan, ...]:
    """The query's scans, levelled in each way that is worth a search.

    Of a long sequence only the last scans are taken, so that the work has a limit.

    Args:
        expected_up: (3,) unit vector in the last scan's frame, by the mounting; None: up is measured, and
            only heights are varied.
        usual_height_m: of the map's own sensor above the floor, tried beside the height that the scan shows.
        tilted: also by small tilts about the likeliest ups, then with the usual height only.
    """
    last = prepared.scans[-1]
    ups = [last.T_last_scan[:3, :3] @ last.up]
    if expected_up is not None:
        ups += [expected_up, ground_normal(prepared.dense, expected_up)]
        if tilted:
            ups += [up for about in ups[:2] for up in tilts(about)]
    ups = _apart(ups)
    scans = prepared.scans[-max(1, _MAX_LEVELLED // len(ups)) :]
    return tuple(
        levelled
        for up in ups
        for scan in scans
        for levelled in _at_heights(scan, up, usual_height_m, as_seen=not tilted)
    )


def ground_normal(scan: Surface, expected_up: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean normal, (3,) upwards, of the ground around the sensor; the expected up where there is too little.

    A robot stands on the slope that it sees.
    """
    rise = scan.normals @ expected_up
    near = np.linalg.norm(scan.points, axis=1) < _GROUND_WITHIN_M
    ground = scan.normals[near & (np.abs(rise) > _GROUND_COSINE) & (scan.points @ expected_up < 0)]
    if len(ground) < _MIN_GROUND:
        return expected_up
    normal: NDArray[np.float64] = np.linalg.eigh((ground.T @ ground).astype(np.float64))[1][:, 2]
    return normal if normal @ expected_up > 0 else -normal


def tilts(up: NDArray[np.float64]) -> list[NDArray[np.float64]]:
    """Unit vectors (3,) around an up direction (3,), TILT_DEG from it."""
    R_level_sensor, slope = levelling_rotation(up), np.radians(TILT_DEG)
    azimuths = np.arange(TILTS) * 2 * np.pi / TILTS
    return [
        R_level_sensor.T @ [np.sin(slope) * np.cos(a), np.sin(slope) * np.sin(a), np.cos(slope)]
        for a in azimuths
    ]


def _at_heights(
    scan: PreparedScan, up: NDArray[np.float64], usual_height_m: float, *, as_seen: bool
) -> list[PreparedScan]:
    """The scan levelled by an up direction in the last scan's frame, at one height or two."""
    own_up = scan.T_last_scan[:3, :3].T @ up
    usual = replace(with_up(scan, own_up, usual_height_m), height_m=usual_height_m)
    if not as_seen:
        return [usual]
    seen = with_up(scan, own_up, usual_height_m)
    return [seen, usual] if abs(seen.height_m - usual_height_m) > _APART_M else [seen]


def _apart(ups: Iterable[NDArray[np.float64]]) -> list[NDArray[np.float64]]:
    """The up vectors without those near an earlier one."""
    kept: list[NDArray[np.float64]] = []
    for up in ups:
        if all(up @ other < _APART_COSINE for other in kept):
            kept.append(up)
    return kept

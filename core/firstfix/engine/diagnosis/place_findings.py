"""Findings by the best place of an answer: why it is not localized, and how its sensor stands."""

from __future__ import annotations

import numpy as np

from ...answer.localization import Localization, Reason
from ...answer.options import LocalizeOptions
from ...findings import scan_kinds
from ...findings.finding import Finding
from ...transform import Matrix

_UPRIGHT_COSINE = 0.5  # of 60 degrees: robots lean less than that


def reasons_found(answer: Localization) -> tuple[Finding, ...]:
    """The finding that says the first reason of an answer with its numbers, if it has one of its own."""
    reason = answer.reasons[0] if answer.reasons else None
    kinds = {
        Reason.LOW_INLIER_RATIO: scan_kinds.NO_PLACE_FITS,
        Reason.LOW_PROBABILITY: scan_kinds.UNSURE,
        Reason.SEVERAL_PLACES: scan_kinds.SEVERAL_PLACES,
        Reason.FREE_SPACE_VIOLATION: scan_kinds.THROUGH_SURFACES,
        Reason.NOT_CONVERGED: scan_kinds.NOT_CONVERGED,
        Reason.NO_CANDIDATE: scan_kinds.NO_CANDIDATE,
        Reason.NOT_REGISTERED: scan_kinds.NOT_REGISTERED,
    }
    if reason not in kinds:
        return ()
    numbers: dict[str, float] = {"probability": answer.probability, "places": len(answer.hypotheses)}
    quality = answer.hypotheses[0].quality if answer.hypotheses else None
    if quality is not None:
        numbers["inlier_ratio"] = quality.inlier_ratio
        numbers["free_space_violation"] = quality.free_space_violation
    return (kinds[reason].found(numbers),)


def mounting_finding(answer: Localization, options: LocalizeOptions) -> Finding | None:
    """The finding that a localized robot, or its sensor, does not stand upright in the map.

    Gravity says how a sensor hangs, so it is only told where the query has none.
    """
    T_map_body, body = answer.T_map_base, "robot's base"
    if T_map_body is None:
        T_map_body, body = answer.T_map_sensor, "sensor"
    if T_map_body is None or (options.T_base_sensor is None and options.gravity is not None):
        return None
    if T_map_body[2, 2] > _UPRIGHT_COSINE:
        return None
    roll_deg, pitch_deg = roll_pitch_deg(T_map_body)
    return scan_kinds.MOUNTING.found({"roll_deg": roll_deg, "pitch_deg": pitch_deg}, body=body)


def roll_pitch_deg(T_map_body: Matrix) -> tuple[float, float]:
    """Roll about x, then pitch about y, of a (4, 4) pose whose map's z is up."""
    R = T_map_body[:3, :3]
    pitch = -np.arcsin(np.clip(R[2, 0], -1, 1))
    return float(np.degrees(np.arctan2(R[2, 1], R[2, 2]))), float(np.degrees(pitch))

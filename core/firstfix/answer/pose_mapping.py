"""Poses as JSON has them: a position in metres and a quaternion x, y, z, w."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from .. import transform
from ..transform import Matrix


def pose_to_mapping(T: Matrix) -> dict[str, list[float]]:
    """Values ready for JSON."""
    rows = T.tolist()
    return {
        "position": [row[3] for row in rows[:3]],
        "quaternion": transform.quaternion_of_rows(rows),
    }


def pose_from_mapping(data: Mapping[str, Any]) -> Matrix:
    """Reads what ``pose_to_mapping`` returned."""
    return transform.from_quaternion(data["position"], data["quaternion"])

"""How well the covariances of answers cover the truth, by how much the answers say they know."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from firstfix.answer.localization import Localization
from firstfix.transform import Matrix

# Classes end at these standard deviations of the least certain direction.
SHIFTS_M = (0.02, 0.05, 0.2, np.inf)
TURNS_DEG = (0.1, 0.5, 2.0, np.inf)
# The true poses of recorded scans were found by ICP. They are good to 1 to 3 cm, and to 0.1 to 0.2 degrees.
TRUTH_M, TRUTH_DEG = 0.015, 0.1  # along, and about, each axis
WITHIN = float(chi2.ppf(0.95, 3))


def pose_difference(T_true: Matrix, T_found: Matrix) -> NDArray[np.float64]:
    """Error (6,) of a pose as its covariance has it: along, then about, the map's axes, m and rad."""
    turn = T_found[:3, :3] @ T_true[:3, :3].T
    return np.concatenate([T_found[:3, 3] - T_true[:3, 3], Rotation.from_matrix(turn).as_rotvec()])


def nees_by_class(answers: Sequence[tuple[Matrix, Localization]]) -> list[dict[str, Any]]:
    """Normalized errors squared of answered poses, of shifts and of turns, a row for each class that has any.

    ``nees``: mean of e' P^-1 e / 3; 1 if the covariance is honest. ``nees_with_truth``: the same with the
    truth's own error in P. ``within``: share of the true poses in the 95 % ellipsoid of the latter.
    ``degenerate``: answers that name a free direction.

    Args:
        answers: (4, 4) true pose, and the answer with a pose and a covariance.
    """
    kinds = (
        ("shift", slice(0, 3), np.array(SHIFTS_M), TRUTH_M),
        ("turn", slice(3, 6), np.radians(TURNS_DEG), np.radians(TRUTH_DEG)),
    )
    rows = []
    for kind, part, ends, truth in kinds:
        found: dict[int, list[tuple[float, float, bool]]] = {}
        for T_true, answer in answers:
            assert answer.T_map_sensor is not None
            assert answer.covariance is not None
            error = pose_difference(T_true, answer.T_map_sensor)[part]
            P = answer.covariance[part, part]
            number = int(np.searchsorted(ends, np.sqrt(np.linalg.eigvalsh(P)[-1])))
            alone, with_truth = (
                float(error @ np.linalg.solve(one, error)) for one in (P, P + truth**2 * np.eye(3))
            )
            found.setdefault(number, []).append((alone, with_truth, bool(answer.degenerate)))
        for number, of_class in sorted(found.items()):
            alone_, with_truth_, degenerate = np.array(of_class).T
            rows.append(
                {
                    "kind": kind,
                    "sigma_below": float(ends[number]),
                    "n": len(of_class),
                    "nees": round(float(alone_.mean()) / 3, 2),
                    "nees_with_truth": round(float(with_truth_.mean()) / 3, 2),
                    "within": round(float((with_truth_ <= WITHIN).mean()), 3),
                    "degenerate": int(degenerate.sum()),
                }
            )
    return rows

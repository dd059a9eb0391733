"""Figures of a peer's answers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from firstfix.transform import Matrix, pose_error

from .trial import LIMIT_S, Found

RIGHT = {"0.2m_1deg": (0.2, 1.0), "1m_5deg": (1.0, 5.0)}
WRONG_M = {"wrong": 1.0, "wrong_0.2m": 0.2}


def figures_of(T_map_sensor: Sequence[Matrix], found: Sequence[Found]) -> dict[str, Any]:
    """Returns the figures of at least one answer.

    ``success_*``: share answered within these metres and degrees of the whole rotation. ``wrong``: answers
    off by more than 1 m, ``wrong_0.2m``: by more than 0.2 m. ``no_answer``: the peer said that it had none,
    or was ended (``timed_out``). Times are those of all queries. ``answers``: metres, degrees and seconds of
    each query; no metres: no answer.

    Args:
        T_map_sensor: (4, 4) true poses.
        found: the answer to each.
    """
    each = [
        None if one.T_map_sensor is None else pose_error(true, one.T_map_sensor)
        for true, one in zip(T_map_sensor, found, strict=True)
    ]
    errors = [error for error in each if error is not None]
    seconds = [one.seconds for one in found]
    return {
        "n": len(found),
        **{
            f"success_{name}": round(
                sum(m <= most_m and deg <= most_deg for m, deg in errors) / len(found), 4
            )
            for name, (most_m, most_deg) in RIGHT.items()
        },
        **{name: sum(m > limit for m, _ in errors) for name, limit in WRONG_M.items()},
        "no_answer": len(found) - len(errors),
        "timed_out": sum(s >= LIMIT_S for s in seconds),
        "median_error_m": round(float(np.median([m for m, _ in errors])), 4) if errors else None,
        "median_s": round(float(np.median(seconds)), 4),
        "p95_s": round(float(np.percentile(seconds, 95)), 4),
        "answers": [
            [*([None, None] if error is None else (round(float(v), 4) for v in error)), round(s, 4)]
            for error, s in zip(each, seconds, strict=True)
        ],
    }

"""Agreement of two checkouts' answers to the same queries."""

from __future__ import annotations

from typing import Any

import numpy as np

from firstfix.transform import pose_error

Answer = dict[str, Any]  # as ``serve.Answerer.ask`` returns it


def agreement(here: list[Answer], beside: list[Answer]) -> dict[str, Any]:
    """How many verdicts and reasons are equal, and how far poses and probabilities are apart.

    Poses are compared where both answers are ``localized``.
    """
    pairs = list(zip(here, beside, strict=True))
    found: dict[str, Any] = {
        "answers": len(pairs),
        "same_verdict_and_reasons": sum(_outcome(one) == _outcome(other) for one, other in pairs),
        "other_outcomes": [
            f"{'/'.join(_outcome(other))} -> {'/'.join(_outcome(one))}"
            for one, other in pairs
            if _outcome(one) != _outcome(other)
        ],
        "probability_apart_max": max(abs(one["probability"] - other["probability"]) for one, other in pairs),
    }
    both = [pair for pair in pairs if all(answer["T_map_sensor"] is not None for answer in pair)]
    if both:
        apart = [
            pose_error(np.array(one["T_map_sensor"]), np.array(other["T_map_sensor"])) for one, other in both
        ]
        apart_mm, apart_deg = 1e3 * np.array(apart)[:, 0], np.array(apart)[:, 1]
        found |= {
            "both_localized": len(both),
            "apart_median_mm": round(float(np.median(apart_mm)), 4),
            "apart_max_mm": round(float(apart_mm.max()), 3),
            "apart_median_deg": round(float(np.median(apart_deg)), 5),
            "apart_max_deg": round(float(apart_deg.max()), 4),
        }
    return found


def _outcome(answer: Answer) -> tuple[str, ...]:
    return answer["verdict"], *answer["reasons"]

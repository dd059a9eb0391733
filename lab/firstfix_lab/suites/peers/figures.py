"""Figures of a peer's answers, by docs/benchmark-protocol.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from firstfix.transform import Matrix, pose_error

from ...score.metrics import report_of
from ...score.scored import Scored
from .trial import LIMIT_S, Found, Preparation

# One answer: error_m, error_deg, confidence, 1 if accepted, seconds, processor seconds, bytes sent.
AnswerRow = Sequence[Any]
FROM_REPORT = ("success_0.2m_1deg", "success_1m_5deg", "success_2m_5deg", "right_first", "accepted")
FROM_REPORT += ("false_accepts", "no_pose", "coverage_at_risk_0", "area_under_risk_coverage")
DIGITS = 4


def answer_row(true: Matrix, found: Found, sent_bytes: int) -> AnswerRow:
    """An answer as it is kept. Errors and confidence are None without a pose.

    Args:
        true: (4, 4) T_map_sensor.
        sent_bytes: that a robot sends for it.
    """
    answer = found.answer
    told: list[float | None] = [None, None, None]
    if answer.T_map_sensor is not None:
        confidence = None if answer.confidence is None else float(answer.confidence)
        told = [*map(float, pose_error(true, answer.T_map_sensor)), confidence]
    rounded = [None if value is None else round(value, DIGITS) for value in told]
    took = round(found.seconds, DIGITS), round(found.cpu_s, DIGITS)
    return [*rounded, int(answer.is_accepted), *took, sent_bytes]


def scored_answer(row: AnswerRow) -> Scored:
    """An answer as the metrics see it."""
    error_m, error_deg, confidence, is_accepted, seconds, *_ = row
    if error_m is None:
        return Scored(True, time_s=seconds)
    return Scored(True, error_m, error_deg, True, bool(is_accepted), confidence, seconds)


def figures_of(rows: Sequence[AnswerRow], preparation: Preparation, peak_bytes: int) -> dict[str, Any]:
    """The figures of at least one answer.

    ``success_*`` and ``false_accepts``: of accepted poses. ``right_first``: within 0.2 m and 1 degree,
    accepted or not. ``coverage_at_risk_0`` and ``area_under_risk_coverage``: by the peer's own confidence.
    Times are those of all queries; one that was ended (``timed_out``) took the limit. ``*_cpu_s``: processor
    time.

    Args:
        peak_bytes: of memory while it was asked.
    """
    took = {
        "preparation_s": round(preparation.seconds, 2),
        "preparation_cpu_s": round(preparation.cpu_s, 2),
        "preparation_peak_mb": round(preparation.peak_bytes / 1e6),
        "peak_mb": round(peak_bytes / 1e6),
    }
    return {**_of_answers(rows), **took, "answers": [list(row) for row in rows]}


def together(figures: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The figures of a peer over several data sets: preparation added up, the largest memory."""
    found = _of_answers([row for one in figures for row in one["answers"]])
    for key in ("preparation_s", "preparation_cpu_s"):
        found[key] = round(sum(one[key] for one in figures), 2)
    for key in ("preparation_peak_mb", "peak_mb"):
        found[key] = max(one[key] for one in figures)
    return found


def _of_answers(rows: Sequence[AnswerRow]) -> dict[str, Any]:
    report = report_of([scored_answer(row) for row in rows])
    errors_m = [row[0] for row in rows if row[0] is not None]
    seconds, cpu_s = ([row[column] for row in rows] for column in (4, 5))
    return {
        "n": len(rows),
        **{key: report[key] for key in FROM_REPORT},
        "timed_out": sum(s >= LIMIT_S for s in seconds),
        "median_error_m": _percentile(errors_m, 50) if errors_m else None,
        "median_s": _percentile(seconds, 50),
        "p95_s": _percentile(seconds, 95),
        "median_cpu_s": _percentile(cpu_s, 50),
        "p95_cpu_s": _percentile(cpu_s, 95),
        "median_sent_bytes": round(_percentile([row[6] for row in rows], 50)),
    }


def _percentile(values: Sequence[float], percent: float) -> float:
    return round(float(np.percentile(values, percent)), DIGITS)

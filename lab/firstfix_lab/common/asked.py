"""Scans with true poses that were asked, and the figures of the answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from firstfix.answer.localization import Localization, Verdict
from firstfix.transform import Matrix, pose_error

from ..evaluation.outcome import FALSE_DEG, FALSE_M, WRONG_M

RIGHT_M, RIGHT_DEG = 0.2, 1.0  # of the whole rotation


@dataclass(frozen=True)
class Asked:
    """One query and its answer.

    Attributes:
        gravity: "estimated" by the engine, or "given".
        T_map_sensor: true poses by the name of the reference; the first one is judged by.
        ms: in process.
    """

    scan: str
    variant: str
    gravity: str
    T_map_sensor: Mapping[str, Matrix]
    answer: Localization
    ms: float

    def first_error(self, reference: str) -> tuple[float, float]:
        """Metres and degrees from the true pose to the first hypothesis, whatever the verdict."""
        return min(self._errors(reference)[:1], default=(np.inf, np.inf))

    def is_right_first(self, reference: str) -> bool:
        """True if the first hypothesis is right."""
        return any(_is_right(error) for error in self._errors(reference)[:1])

    def is_right_among(self, reference: str) -> bool:
        """True if any hypothesis is right."""
        return any(_is_right(error) for error in self._errors(reference))

    def answer_error(self, reference: str) -> tuple[float, float] | None:
        """Metres and degrees from the true pose to the answered one, if there is one."""
        if self.answer.T_map_sensor is None:
            return None
        return pose_error(self.T_map_sensor[reference], self.answer.T_map_sensor)

    @property
    def T_judged(self) -> Matrix:
        """True pose by the first reference."""
        return next(iter(self.T_map_sensor.values()))

    @property
    def is_wrong(self) -> bool:
        """True if an answered pose is off by more than 1 m or 10 degrees."""
        return self._is_off_by(FALSE_M)

    def _is_off_by(self, limit_m: float) -> bool:
        error = self.answer_error(next(iter(self.T_map_sensor)))
        return error is not None and not (error[0] <= limit_m and error[1] <= FALSE_DEG)

    @property
    def is_off(self) -> bool:
        """True if an answered pose is off by more than 0.2 m, or 10 degrees."""
        return self._is_off_by(WRONG_M)

    def _errors(self, reference: str) -> list[tuple[float, float]]:
        true = self.T_map_sensor[reference]
        return [pose_error(true, hypothesis.T_map_sensor) for hypothesis in self.answer.hypotheses]


def figures_of(asked: Sequence[Asked]) -> dict[str, Any]:
    """The figures of at least one query.

    ``right_first``, ``right_among``: share with a first hypothesis, or any, within 0.2 m and 1 degree.
    ``localized_right``: share answered with such a pose. ``wrong``: number of answered poses off by more than
    1 m or 10 degrees from the first reference, ``wrong_0.2m`` by more than 0.2 m or 10 degrees. ``error_m``
    and ``error_deg``: of the answered poses, None without any.
    """
    return {
        "n": len(asked),
        "verdicts": {verdict.value: sum(a.answer.verdict is verdict for a in asked) for verdict in Verdict},
        "reasons": dict(Counter(reason.value for a in asked for reason in a.answer.reasons)),
        "wrong": sum(a.is_wrong for a in asked),
        "wrong_0.2m": sum(a.is_off for a in asked),
        "against": {reference: _against(asked, reference) for reference in asked[0].T_map_sensor},
        "ms": _percentiles([a.ms for a in asked]),
    }


def _against(asked: Sequence[Asked], reference: str) -> dict[str, Any]:
    errors = [error for a in asked if (error := a.answer_error(reference)) is not None]
    return {
        "right_first": _share([a.is_right_first(reference) for a in asked]),
        "right_among": _share([a.is_right_among(reference) for a in asked]),
        "localized_right": sum(map(_is_right, errors)) / len(asked),
        "error_m": _percentiles([m for m, _ in errors]),
        "error_deg": _percentiles([deg for _, deg in errors]),
    }


def _is_right(error: tuple[float, float]) -> bool:
    return error[0] <= RIGHT_M and error[1] <= RIGHT_DEG


def _share(flags: Sequence[bool]) -> float:
    return float(np.mean(flags))


def _percentiles(values: Sequence[float]) -> dict[str, float] | None:
    return {f"p{q}": round(float(np.percentile(values, q)), 4) for q in (50, 95)} if values else None

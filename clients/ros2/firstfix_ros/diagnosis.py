"""Diagnostics from a status: level, message and values. This module does not import ROS."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix_client.first_fix import State, Status

OK, WARN, ERROR = range(3)  # of diagnostic_msgs/DiagnosticStatus
_LEVELS = {State.NOT_LOCALIZED: WARN, State.FAILED: ERROR}


@dataclass(frozen=True)
class Diagnosis:
    """Fields of a diagnostic_msgs/DiagnosticStatus."""

    level: int
    message: str
    values: dict[str, str]


def diagnosis_of(status: Status) -> Diagnosis:
    """Returns the diagnosis for a status."""
    message = status.state.value + (f": {status.error}" if status.error else "")
    values = {"tries": str(status.tries), "took_s": f"{status.took_s:.3f}"}
    answer = status.answer
    if answer is not None:
        values |= {
            "verdict": answer.verdict.value,
            "reasons": ", ".join(reason.value for reason in answer.reasons),
            "probability": f"{answer.probability:.3f}",
            "map_id": answer.map_id,
            "map_version": answer.map_version,
            "map_provisional": str(answer.map_provisional).lower(),
        }
    return Diagnosis(_LEVELS.get(status.state, OK), message, values)

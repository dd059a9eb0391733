"""Cases of results as the benchmark protocol scores them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ..score.scored import Scored
from ..suites.peers.figures import scored_answer
from ..suites.peers.report import measured
from .result import Result

Row = Mapping[str, Any]
GRAVITIES = ("estimated", "given")
AS_IT_IS = "as it is"


def references(result: Result) -> dict[str, list[str]]:
    """The names of the references of each set of the real suite; the first is judged by."""
    return {
        name: list(next(iter(found["variants"].values()))[GRAVITIES[0]]["against"])
        for name, found in result.figures.items()
        if isinstance(found, dict) and "variants" in found
    }


def real_cases(result: Result, wanted: Callable[[Row], bool]) -> list[Scored]:
    """The wanted cases of the real suite, scored by the first reference of their set."""
    judged_by = {name: found[0] for name, found in references(result).items()}
    return [
        scored_row(row)
        for row in result.cases or ()
        if row["reference"] == judged_by[row["set"]] and wanted(row)
    ]


def scored_row(row: Row) -> Scored:
    """One case of the real suite: the best hypothesis, which is accepted if the answer is ``localized``."""
    error_m, error_deg = row["first_error_m"], row["first_error_deg"]
    has_pose = error_m is not None
    return Scored(
        True,
        error_m if has_pose else np.inf,
        error_deg if has_pose else np.inf,
        has_pose,
        row["verdict"] == "localized",
        row["probability"],
        row["ms"] / 1e3,
    )


def peer_cases(result: Result) -> dict[str, list[Scored]]:
    """The answers of each peer to the scans of all sets."""
    found: dict[str, list[Scored]] = {}
    for of_set in result.figures.values():
        for peer, figures in measured(of_set).items():
            found.setdefault(peer, []).extend(map(scored_answer, figures["answers"]))
    return found

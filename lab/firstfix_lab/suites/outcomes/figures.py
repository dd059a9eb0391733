"""Figures of the table of outcomes, each map judged by what the maps of other places teach."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from firstfix.builds.config import SelfTestConfig
from firstfix.engine.false_accept_bound import upper_bound
from firstfix_builder.self_test.taught_outcomes import (
    ALIKE,
    ELSEWHERE,
    HERE,
    TaughtOutcome,
    TaughtOutcomes,
)

PROMISE = SelfTestConfig().max_false_accept


def figures_of(taught: TaughtOutcomes) -> dict[str, Any]:
    """Figures of each map and of all, by the rule of ``threshold.choose`` with the ceiling of the others.

    ``right`` of ``here`` scans have the right place first, of these ``localized`` are; ``wrong`` are
    localized elsewhere; ``elsewhere`` and ``alike`` are accepted scans of other places.
    """
    rows, every = {}, []
    for name in dict.fromkeys(row.map for row in taught.rows):
        own = [row for row in taught.rows if row.map == name]
        ceiling = taught.ceiling(PROMISE, but_of=own[0].place)
        threshold = own[0].own_threshold
        if ceiling is not None:
            threshold = min(threshold, ceiling.min_probability)
        accepted = [row for row in own if row.case.claimed >= threshold]
        every += [(row, row.case.claimed >= threshold) for row in own]
        rows[name] = {"sensor": own[0].sensor, "threshold": threshold, **_counts(own, accepted)}
    accepted = [row for row, is_accepted in every if is_accepted]
    total = _counts(taught.rows, accepted)
    natural = [row for row in accepted if row.kind != ALIKE]
    wrong = sum(not row.case.right for row in natural)
    total["wrong_at_most"] = round(upper_bound(wrong, len(natural)), 6)
    return {"maps": rows, "all": total, "taught": taught.to_mapping()}


def told(figures: dict[str, Any]) -> str:
    """The figures as a Markdown table."""
    names = ("sensor", "threshold", "here", "right", "localized", "wrong", "elsewhere", "alike")
    lines = ["| map | " + " | ".join(names) + " |", "|---" * (len(names) + 1) + "|"]
    for name, row in [*figures["maps"].items(), ("all", figures["all"])]:
        lines.append(f"| {name} | " + " | ".join(str(row.get(key, "")) for key in names) + " |")
    return "\n".join([*lines, "", str(figures["taught"])])


def _counts(rows: Sequence[TaughtOutcome], accepted: Sequence[TaughtOutcome]) -> dict[str, Any]:
    def share(kind: str) -> str:
        return f"{sum(row.kind == kind for row in accepted)} of {sum(row.kind == kind for row in rows)}"

    here = [row for row in accepted if row.kind == HERE]
    return {
        "here": sum(row.kind == HERE for row in rows),
        "right": sum(row.kind == HERE and row.case.right for row in rows),
        "localized": sum(row.case.right for row in here),
        "wrong": sum(not row.case.right for row in here),
        "elsewhere": share(ELSEWHERE),
        "alike": share(ALIKE),
    }

"""The figures of the ablations as Markdown."""

from __future__ import annotations

from collections.abc import Mapping

from ...common.by_dataset import Figures
from ...common.markdown import table
from .parts import PARTS, WHOLE

HEAD = (
    "taken out",
    "section",
    "right first",
    "localized, right",
    "wrong by over 0.2 m",
    "false accepts",
    "processor time",
)


def report(figures: Mapping[str, Figures | str]) -> str:
    """A table of all sets together, then one of each.

    *Right*: within 0.2 m and 1 degree. *False accepts* are answers off by more than 1 m or 10 degrees.
    Processor time is the sum over all scans, as a share of the whole method's.
    """
    measured = {name: found for name, found in figures.items() if not isinstance(found, str)}
    lines = _section("All sets", list(measured.values())) if measured else []
    for name, found in figures.items():
        lines += [f"### {name}", "", found, ""] if isinstance(found, str) else _section(name, [found])
    return "\n".join(lines)


def _section(name: str, sets: list[Figures]) -> list[str]:
    whole_ms = _sum(sets, WHOLE.name, "cpu_ms")
    rows = [
        (
            part.name,
            part.section,
            f"{_mean(sets, part.name, 'right_first'):.3f}",
            f"{_mean(sets, part.name, 'localized_right'):.3f}",
            int(_sum(sets, part.name, "wrong_0.2m")),
            int(_sum(sets, part.name, "wrong")),
            f"{_sum(sets, part.name, 'cpu_ms') / whole_ms:.2f}",
        )
        for part in PARTS
    ]
    count = int(_sum(sets, WHOLE.name, "n"))
    return [f"### {name} ({count} scans)", "", *table(HEAD, rows), ""]


def _sum(sets: list[Figures], part: str, name: str) -> float:
    return float(sum(found[part][name] for found in sets))


def _mean(sets: list[Figures], part: str, name: str) -> float:
    """Mean over all scans of all sets."""
    count = _sum(sets, part, "n")
    return float(sum(found[part]["n"] * found[part]["against"]["truth"][name] for found in sets)) / count

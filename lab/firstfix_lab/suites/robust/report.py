"""The figures as Markdown: what the suite is judged by, the sensors, and then one table a world."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

from ...common.markdown import table
from .figures import NEES_MEDIAN

BARS = {
    "": "asked for",
    "answers": "8000",
    "distinct": "",
    "found": "",
    "first": "0.98",
    "within_0.2m_2deg": "",
    "localized": "0.8 (all: 0.93)",
    "aliases": "",
    "aliases_recognised": "0.95",
    "outshone": "",
    "outshone_recognised": "",
    "false_accepts": "1 in 1000",
    "false_accepts_at_most": "",
    "wrong_0.2m": "1 in 500",
    "ece": "0.02",
    "look_alikes_ece": "0.05",
    "ms": "",
}
BAR_HEADER = (
    "answers",
    "distinct",
    "true place among the hypotheses",
    "right first",
    "within 0.2 m and 2 deg",
    "localized",
    "aliases",
    "ambiguous, truth among them",
    "outshone",
    "ambiguous, truth among them",
    "false accepts",
    "at most (95 %)",
    "wrong by over 0.2 m",
    "ECE",
    "ECE of look-alikes",
    "ms p50 / p95 / p99",
)
EXPLANATION = """\
Shares are of the *distinct* scans: at the true pose they fit the map better, by 0.02 of the alignment score,
than at any other place that was found. *Aliases* fit another place as well. *Outshone* scans fit another
place better, because the map lacks what they show. *At most*: upper end of the share of false accepts among
all answers, inside and outside the map (Clopper-Pearson).
"""
HEADER = (
    "n",
    "0.05 m",
    "0.2 m",
    "0.5 m",
    "0.2 m, 2 deg",
    "of the distinct (n)",
    "aliases recognised as ambiguous",
    "among all 0.2 m",
    "right first",
    "localized / ambiguous / rejected",
    "0.2 m of localized",
    "false accepts",
    "wrong by over 0.2 m",
    "ECE",
    f"NEES ({NEES_MEDIAN})",
    "ms p50 / p95 / p99",
)


def report(figures: Mapping[str, Any]) -> str:
    measured = {name: world for name, world in figures["worlds"].items() if not isinstance(world, str)}
    bars = {name: world["bars"] for name, world in measured.items()}
    if figures["bars"] is not None:
        bars["all worlds"] = figures["bars"]
    parts = [
        _table("What the suite is judged by", "world", BAR_HEADER, bars, _bar_cells, (BARS.values(),)),
        EXPLANATION,
        _table("By asking sensor", "sensor", BAR_HEADER, figures["sensors"], _bar_cells),
        _table("By asking sensor and templates", "sensors", BAR_HEADER, figures["pairs"], _bar_cells),
    ]
    for name, world in figures["worlds"].items():
        if isinstance(world, str):
            parts.append(f"### {name}\n\n{world}\n")
            continue
        built = ", ".join(f"{count} {sensor}" for sensor, count in world["templates"].items())
        title = f"{name} (templates: {built}; {world['seconds']} s)"
        parts.append(_table(title, "case", HEADER, world["cases"], _cells))
    parts.append(_table("All worlds", "worlds", HEADER, figures["total"], _cells))
    return "\n".join(parts)


def _table(
    title: str,
    first: str,
    header: Sequence[str],
    rows: Mapping[str, Mapping[str, Any]],
    cells: Callable[[Mapping[str, Any]], Iterable[Any]],
    more: Iterable[Iterable[Any]] = (),
) -> str:
    lines = table((first, *header), [*((name, *cells(row)) for name, row in rows.items()), *more])
    return "\n".join([f"### {title}", "", *lines]) + "\n"


def _bar_cells(row: Mapping[str, Any]) -> list[Any]:
    return [_milliseconds(row[name]) if name == "ms" else row[name] for name in BARS if name]


def _cells(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return (
        row["n"],
        row["success_0.05m"],
        row["success_0.2m"],
        row["success_0.5m"],
        row["success_0.2m_2deg"],
        None if row["distinct_0.2m_2deg"] is None else f"{row['distinct_0.2m_2deg']} ({row['distinct']})",
        row["aliases_recognised"],
        row["among_all_0.2m"],
        row["first"],
        " / ".join(str(count) for count in row["verdicts"].values()),
        row["right_localized"],
        row["false_accepts"],
        row["wrong_0.2m"],
        row["ece"],
        row["nees_median"],
        _milliseconds(row["ms"]),
    )


def _milliseconds(percentiles: Mapping[str, float]) -> str:
    return " / ".join(f"{ms:.0f}" for ms in percentiles.values())

"""The figures of the real suite as Markdown: a table for each data set."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..common.by_dataset import Figures, sections
from ..common.markdown import table

HEAD = (
    "scans",
    "gravity",
    "reference",
    "right first",
    "right among",
    "localized, right",
    "localized / ambiguous / rejected",
    "wrong",
    "error m p50 / p95",
    "error deg p50 / p95",
    "ms p50 / p95",
)


def report(figures: Mapping[str, Figures | str]) -> str:
    """Returns a section for each data set of ``suite.run``.

    *Right*: within 0.2 m and 1 degree of the reference. *Wrong*: localized and off by more than 1 m or 10
    degrees. The errors are those of the localized scans.
    """
    return sections(figures, _section)


def _section(found: Figures) -> list[str]:
    build = found["build"]
    lines = [
        f"Build: {build['build_s']} s, {build['build_peak_gb']} GB at most, version of "
        f"{build['bytes'] / 1e6:.0f} MB.",
        *(_http_line(gravity, evaluated) for gravity, evaluated in found["over_http"].items()),
        "",
    ]
    asked = [
        cells
        for variant, by_gravity in found["variants"].items()
        for gravity, figures in by_gravity.items()
        for cells in _cells(variant, gravity, figures)
    ]
    lines += table(HEAD, asked)
    reasons = [
        f"* {variant}, gravity {gravity}: {_counts(figures['reasons'])}"
        for variant, by_gravity in found["variants"].items()
        for gravity, figures in by_gravity.items()
        if figures["reasons"]
    ]
    return [*lines, "", "Reasons of the answers that are not localized:", "", *(reasons or ["none"])]


def _http_line(gravity: str, evaluated: Mapping[str, Any]) -> str:
    ms, verdicts = evaluated["ms"], evaluated["verdicts"]
    return (
        f"Over HTTP, gravity {gravity}: {verdicts['localized']} of {evaluated['n']} localized, "
        f"{ms['p50']:.0f} / {ms['p95']:.0f} ms p50 / p95."
    )


def _cells(variant: str, gravity: str, figures: Mapping[str, Any]) -> list[list[str]]:
    verdicts = " / ".join(str(number) for number in figures["verdicts"].values())
    return [
        [
            f"{variant} ({figures['n']})",
            gravity,
            reference,
            *(f"{against[key]:.2f}" for key in ("right_first", "right_among", "localized_right")),
            verdicts,
            str(figures["wrong"]),
            _pair(against["error_m"], 3),
            _pair(against["error_deg"], 2),
            _pair(figures["ms"], 0),
        ]
        for reference, against in figures["against"].items()
    ]


def _pair(percentiles: Mapping[str, float] | None, digits: int) -> str:
    if percentiles is None:
        return "-"
    return " / ".join(f"{percentiles[q]:.{digits}f}" for q in ("p50", "p95"))


def _counts(reasons: Mapping[str, int]) -> str:
    return ", ".join(f"{reason} {number}" for reason, number in sorted(reasons.items()))

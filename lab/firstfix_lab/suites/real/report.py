"""The figures of the real suite as Markdown: a table for each data set."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ...common.by_dataset import Figures, sections
from ...common.markdown import table

HEAD = (
    "scans",
    "gravity",
    "reference",
    "right first",
    "right among",
    "localized, right",
    "localized / ambiguous / rejected",
    "wrong",
    "wrong by over 0.2 m",
    "error m p50 / p95",
    "error deg p50 / p95",
    "ms p50 / p95",
)


NEES_HEAD = (
    "covariance of",
    "sigma below",
    "answers",
    "NEES / 3",
    "with the truth's error",
    "in the 95 % ellipsoid",
    "degenerate",
)


def report(figures: Mapping[str, Figures | str]) -> str:
    """A section for each data set of ``suite.run``.

    *Right*: within 0.2 m and 1 degree of the reference. *Wrong*: localized and off by more than 1 m or 10
    degrees. The errors are those of the localized scans. The last table has the covariances of those that are
    not wrong, of all variants, by the least certain direction (``nees_by_class``).
    """
    return sections(figures, _section)


def _section(found: Figures) -> list[str]:
    build = found["build"]
    lines = [
        f"Build: {build['build_s']} s, {build['build_peak_gb']} GB at most, version of "
        f"{build['bytes'] / 1e6:.0f} MB.",
        *(_http_line(gravity, evaluated) for gravity, evaluated in found["over_http"].items()),
        _strangers_line(found["strangers"]),
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
    lines += ["", "Reasons of the answers that are not localized:", "", *(reasons or ["none"])]
    return [*lines, "", *table(NEES_HEAD, [_nees_cells(row) for row in found["nees"]])]


def _http_line(gravity: str, evaluated: Mapping[str, Any]) -> str:
    ms, verdicts = evaluated["ms"], evaluated["verdicts"]
    return (
        f"Over HTTP, gravity {gravity}: {verdicts['localized']} of {evaluated['n']} localized, "
        f"{ms['p50']:.0f} / {ms['p95']:.0f} ms p50 / p95."
    )


def _strangers_line(asked: Mapping[str, Any]) -> str:
    return f"Scans of other places: {len(asked['localized'])} of {asked['n']} localized."


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
            str(figures["wrong_0.2m"]),
            _pair(against["error_m"], 3),
            _pair(against["error_deg"], 2),
            _pair(figures["ms"], 0),
        ]
        for reference, against in figures["against"].items()
    ]


def _nees_cells(row: Mapping[str, Any]) -> list[str]:
    is_shift = row["kind"] == "shift"
    below = f"{row['sigma_below']:g} m" if is_shift else f"{math.degrees(row['sigma_below']):.3g} deg"
    figures = (row["n"], row["nees"], row["nees_with_truth"], row["within"], row["degenerate"])
    return [row["kind"], below if math.isfinite(row["sigma_below"]) else "any", *map(str, figures)]


def _pair(percentiles: Mapping[str, float] | None, digits: int) -> str:
    if percentiles is None:
        return "-"
    return " / ".join(f"{percentiles[q]:.{digits}f}" for q in ("p50", "p95"))


def _counts(reasons: Mapping[str, int]) -> str:
    return ", ".join(f"{reason} {number}" for reason, number in sorted(reasons.items()))

"""The figures of the suite as Markdown: success and time, as papers on global localization give them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

HEAD = (
    "recording",
    "gravity",
    "scans",
    "0.2 m, 1 deg",
    "0.5 m, 5 deg",
    "1 m, 5 deg",
    "2 m, 10 deg",
    "right first",
    "localized / ambiguous / rejected",
    "wrong by over 1 m or 10 deg",
    "time ms, mean",
    "p50 / p95",
)


def report(figures: Mapping[str, Any]) -> str:
    """Returns a table of the recordings and one of the maps.

    Success is the share of all scans that were localized this close; an answer that is not localized is no
    success. ``right first``: the first hypothesis is within 0.2 m and 1 degree, whatever the verdict.
    """
    rows = [_row(HEAD), "|---" * len(HEAD) + "|"]
    total = {"all": figures["total"]} if "total" in figures else {}
    for name, by_gravity in {**figures["recordings"], **total}.items():
        if isinstance(by_gravity, str):
            rows.append(f"| {name} | {by_gravity} |")
            continue
        rows += [_row(_cells(name, gravity, found)) for gravity, found in by_gravity.items()]
    maps = [
        f"* {name}: built in {built['build_s']} s, {built['templates']} templates"
        for name, built in figures["maps"].items()
    ]
    return "\n".join([*rows, "", *maps]) + "\n"


def _cells(name: str, gravity: str, found: Mapping[str, Any]) -> tuple[str, ...]:
    success = (f"{share:.3f}" for share in found["success"].values())
    return (
        name,
        gravity,
        str(found["n"]),
        *success,
        f"{found['against']['truth']['right_first']:.3f}",
        " / ".join(str(number) for number in found["verdicts"].values()),
        str(found["wrong"]),
        f"{found['mean_ms']:.0f}",
        f"{found['ms']['p50']:.0f} / {found['ms']['p95']:.0f}",
    )


def _row(cells: tuple[str, ...]) -> str:
    return f"| {' | '.join(cells)} |"

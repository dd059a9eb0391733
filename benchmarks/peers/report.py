"""The figures of the peers as Markdown: a table for each data set."""

from __future__ import annotations

from collections.abc import Mapping

from ..common.by_dataset import Figures, sections
from ..common.markdown import table

COLUMNS = {
    "success_0.2m_1deg": "0.2 m, 1 deg",
    "success_1m_5deg": "1 m, 5 deg",
    "wrong": "wrong by over 1 m",
    "wrong_0.2m": "wrong by over 0.2 m",
    "no_answer": "no answer",
    "timed_out": "timed out",
    "median_error_m": "median error m",
    "median_s": "median s",
    "p95_s": "p95 s",
    "preparation_s": "map prepared, s",
}


def report(figures: Mapping[str, Figures | str]) -> str:
    """Returns a section for each data set of ``suite.run``."""
    return sections(figures, _section)


def _section(rows: Figures) -> list[str]:
    peers = [
        (peer, row) if isinstance(row, str) else (peer, *(row[key] for key in COLUMNS))
        for peer, row in rows.items()
        if peer != "asked"
    ]
    asked = f"{len(rows['asked'])} scans: {', '.join(rows['asked'])}"
    return [asked, "", *table(("method", *COLUMNS.values()), peers)]

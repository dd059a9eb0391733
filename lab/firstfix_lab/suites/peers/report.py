"""The figures of the peers as Markdown: where a peer wins, a table of all sets, and one of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ...common.by_dataset import Figures, sections
from ...common.markdown import table
from .figures import together

OURS = ("firstfix", "firstfix, gravity given")
Rows = Mapping[str, dict[str, Any]]
COLUMNS = {
    "success_0.2m_1deg": "accepted within 0.2 m, 1 deg",
    "success_1m_5deg": "within 1 m, 5 deg",
    "success_2m_5deg": "within 2 m, 5 deg",
    "right_first": "best place right",
    "accepted": "accepted",
    "false_accepts": "false accepts",
    "no_pose": "no answer",
    "coverage_at_risk_0": "answered before the first wrong one",
    "area_under_risk_coverage": "mean risk",
    "median_s": "s, median",
    "p95_s": "s, p95",
    "median_cpu_s": "processor s, median",
    "p95_cpu_s": "processor s, p95",
    "preparation_s": "map prepared, s",
    "preparation_cpu_s": "map prepared, processor s",
    "preparation_peak_mb": "memory for it, MB",
    "peak_mb": "memory of answers, MB",
    "median_sent_bytes": "bytes sent",
}
CONTESTS = {  # figure: what it is called, whether the larger one wins
    "success_0.2m_1deg": ("success within 0.2 m and 1 deg", True),
    "success_1m_5deg": ("success within 1 m and 5 deg", True),
    "success_2m_5deg": ("success within 2 m and 5 deg", True),
    "right_first": ("right first, accepted or not", True),
    "false_accepts": ("false accepts", False),
    "coverage_at_risk_0": ("coverage at no risk", True),
    "median_s": ("seconds of a scan, median", False),
    "p95_s": ("seconds of a scan, p95", False),
    "median_cpu_s": ("processor seconds of a scan", False),
    "preparation_s": ("seconds to prepare the map", False),
    "preparation_cpu_s": ("processor seconds to prepare the map", False),
    "preparation_peak_mb": ("memory to prepare the map, MB", False),
    "peak_mb": ("memory of answers, MB", False),
    "median_sent_bytes": ("bytes sent", False),
}


def report(figures: Mapping[str, Figures | str]) -> str:
    """The comparison of all sets, then a section for each data set of ``suite.run``."""
    head = ["### All sets", "", *wins(figures), "", *table_of(all_sets(figures)), "", ""]
    return "\n".join(head) + sections(figures, _section)


def measured(of_set: Any) -> Rows:
    """The figures of the peers that were asked in a set, by their names."""
    if not isinstance(of_set, dict) or "asked" not in of_set:
        return {}
    return {peer: row for peer, row in of_set.items() if isinstance(row, dict)}


def all_sets(figures: Mapping[str, Any]) -> Rows:
    """The figures of each peer over the sets in which it was asked."""
    found: dict[str, list[dict[str, Any]]] = {}
    for of_set in figures.values():
        for peer, row in measured(of_set).items():
            found.setdefault(peer, []).append(row)
    return {peer: together(rows) for peer, rows in found.items()}


def ranked(rows: Rows) -> list[str]:
    """The peers, the most successful first; of equal ones the quicker."""
    return sorted(rows, key=lambda peer: (-rows[peer]["success_0.2m_1deg"], rows[peer]["median_cpu_s"]))


def table_of(rows: Rows) -> list[str]:
    """A table with a row for each peer, the most successful first."""
    lines = [(f"{peer} ({rows[peer]['n']})", *(rows[peer][key] for key in COLUMNS)) for peer in ranked(rows)]
    return table(("system (scans)", *COLUMNS.values()), lines)


def wins(figures: Mapping[str, Any]) -> list[str]:
    """A line for each figure in which peers beat firstfix over the sets that both were asked in.

    A line names the best of these peers, and says how many others there are: the table has their figures.
    """
    names = [peer for of_set in figures.values() for peer in measured(of_set)]
    peers = [peer for peer in dict.fromkeys(names) if peer not in OURS]
    lines = []
    for key, (name, more) in CONTESTS.items():
        better = {peer: found for peer in peers if (found := _against_ours(figures, peer, key, more))}
        if better:
            best = (max if more else min)(better, key=lambda peer: better[peer][0])
            others = f" (and {len(better) - 1} more)" if len(better) > 1 else ""
            lines.append(f"* {name}: {best} {better[best][0]} against {better[best][1]}{others}")
    return ["**Where another system wins:**", "", *lines] if lines else ["No other system wins anywhere."]


def _against_ours(figures: Mapping[str, Any], peer: str, key: str, more: bool) -> tuple[float, float] | None:
    """A peer's figure and the better one of ours, if the peer's is better still; else None."""
    common = [rows for of_set in figures.values() if peer in (rows := measured(of_set))]
    own = [together([rows[name] for rows in common])[key] for name in OURS if name in common[0]]
    figures_of_peer = together([rows[peer] for rows in common])
    theirs = figures_of_peer[key]
    if theirs is None or not own or None in own or not figures_of_peer["right_first"]:
        return None  # who finds nothing is cheap, and never wrong
    best = max(own) if more else min(own)
    return (theirs, best) if (theirs > best if more else theirs < best) else None


def _section(rows: Figures) -> list[str]:
    skipped: Sequence[tuple[str, str]] = [(peer, row) for peer, row in rows.items() if isinstance(row, str)]
    asked = f"{len(rows['asked'])} scans: {', '.join(rows['asked'])}"
    return [
        asked,
        "",
        *table_of(measured(rows)),
        *([""] if skipped else []),
        *(f"* {a}: {b}" for a, b in skipped),
    ]

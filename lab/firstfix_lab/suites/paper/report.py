"""The figures as Markdown tables, the paper's own beside ours."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from ...common.markdown import table
from .published import DESCRIPTOR_MS, TABLE_2, TABLE_3, TABLE_4, TABLE_5, WITHIN_M


def report(figures: dict[str, Any]) -> str:
    parts = [
        _costs(figures["costs"], figures["peak_memory_gb"]),
        _table_2(figures["table_2"]),
        _table_3(figures["table_3"]),
        _cascade_table("Table IV: KD tree, K = 10", figures["table_4"], TABLE_4),
        _cascade_table("Table V: LSH and KD trees, K = 10", figures["table_5"], TABLE_5),
        _plain("Search engines in the same cascade", figures["engines"]),
        _plain("Methods, held-out perturbed scans", figures["methods"]),
        _plain("Choices", figures["ablation"]),
        _search_time(figures["figures_7_and_8"]),
    ]
    return "\n".join(parts)


def _costs(costs: dict[str, Any], peak_gb: float) -> str:
    descriptor, clustering = costs["descriptor"], costs["clustering"]
    least, most = min(costs["knn_linkage_s"].values()), max(costs["knn_linkage_s"].values())
    chosen = max(costs["knn_representatives_s"].values())
    rows = [
        (
            f"descriptor and CNZ, {descriptor['points']} points, ms",
            descriptor["ours_ms"],
            f"{descriptor['naive_ms']} ({descriptor['ratio']} times ours)",
            DESCRIPTOR_MS,
        ),
        (
            f"clustering {clustering['templates']} templates, s",
            clustering["ours_s"],
            f"{clustering['naive_s']} ({clustering['ratio']} times ours)",
            "-",
        ),
        ("similarity among neighbours, all templates, s", costs["knn_similarity_s"], "-", 10_800),
        ("linkage, all thresholds, s", f"{least} to {most}", "-", "366 to 390"),
        ("representatives, s", chosen, "-", "-"),
        ("peak memory of the suite, GB", peak_gb, "-", "-"),
    ]
    return _markdown("Costs, one thread", ("", "ours", "naive Python, same run", "paper"), rows)


def _table_2(rows: list[dict[str, Any]]) -> str:
    header = (
        "constraint",
        "threshold",
        "clusters",
        "similarity s/scene",
        "clustering s",
        "match s",
        *_within(),
    )
    lines: list[tuple[Any, ...]] = []
    for row in rows:
        similarity_s, clustering_s, clusters, match_s, success = TABLE_2[row["constraint"], row["threshold"]]
        lines.append(
            (
                "paper: " + row["constraint"],
                row["threshold"],
                clusters,
                similarity_s,
                clustering_s,
                match_s,
                *success,
            )
        )
        ours = (row["clusters"], row["similarity_s_per_scene"], row["clustering_s"], row["match_s"])
        lines.append(("ours", "", *ours, *row["success"]))
        lines.append(("ours, held out, perturbed", "", "", "", "", "", *row["success_perturbed"]))
    return _markdown("Table II: with and without local constraints", header, lines)


def _table_3(rows: list[dict[str, Any]]) -> str:
    header = ("scenes", "templates", "match s", *_within())
    lines: list[tuple[Any, ...]] = []
    for row in rows:
        scenes, templates, match_s, success = TABLE_3[row["scenes"], row["templates"]]
        lines.append(
            (f"paper: {scenes} {row['scenes']}", f"{templates} {row['templates']}", match_s, *success)
        )
        counts = (row["number_of_scenes"], row["number_of_templates"])
        lines.append((f"ours: {counts[0]}", counts[1], row["match_s"], *row["success"]))
        if "success_perturbed" in row:
            lines.append(("ours, held out, perturbed", counts[1], "", *row["success_perturbed"]))
    return _markdown("Table III: where each kind of template localizes", header, lines)


def _cascade_table(title: str, rows: list[dict[str, Any]], published: dict[float, Any]) -> str:
    header = ("threshold", "clusters", "search ms", "match ms", *_within())
    lines: list[tuple[Any, ...]] = []
    for row in rows:
        search_ms, match_ms, success = published[row["threshold"]]
        lines.append((f"paper: {row['threshold']}", "", search_ms, match_ms, *success))
        lines.append(("ours", row["clusters"], row["search_ms"], row["match_ms"], *row["success"]))
        lines.append(("ours, held out, perturbed", "", "", "", *row["success_perturbed"]))
    return _markdown(title, header, lines)


def _plain(title: str, rows: list[dict[str, Any]]) -> str:
    """Rows as they are; of a success the shares within the first and the last distance."""
    lines = []
    for row in rows:
        line: list[Any] = []
        for value in row.values():
            line.append(f"{value[0]:.3f} / {value[-1]:.3f}" if isinstance(value, list) else value)
        lines.append(line)
    names = [name + " 0.2 m / 1 m" if name.startswith("success") else name for name in rows[0]]
    return _markdown(title, names, lines)


def _search_time(rows: list[dict[str, Any]]) -> str:
    """One column an engine: milliseconds, and recall where it is not exact."""
    engines = list(dict.fromkeys(row["engine"] for row in rows))
    cells = {(row["samples"], row["dimensions"], row["engine"]): row for row in rows}
    lines = []
    for samples, dimensions in dict.fromkeys((row["samples"], row["dimensions"]) for row in rows):
        each = [cells[samples, dimensions, engine] for engine in engines]
        lines.append(
            (samples, dimensions, *(f"{cell['ms']:.3f} ({cell['recall_at_10']:.2f})" for cell in each))
        )
    return _markdown(
        "Figures 7 and 8: ms a query (recall of the ten nearest)", ("samples", "dimensions", *engines), lines
    )


def _within() -> list[str]:
    return [f"{limit} m" for limit in WITHIN_M]


def _markdown(title: str, header: Sequence[Any], rows: Iterable[Sequence[Any]]) -> str:
    return "\n".join([f"### {title}", "", *table(header, rows)]) + "\n"

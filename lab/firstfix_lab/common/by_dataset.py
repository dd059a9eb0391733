"""Figures of several data sets: which are measured, and their report."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.recorded_data import Dataset

Figures = dict[str, Any]


def measure_each(
    datasets: Iterable[Dataset], names: Sequence[str], measure: Callable[[Dataset, Path], Figures]
) -> dict[str, Figures | str]:
    """The figures of each data set by its name, or why it was skipped.

    Args:
        names: of the data sets that are measured; empty: all.
        measure: is given an empty folder, too.
    """
    found: dict[str, Figures | str] = {}
    for dataset in datasets:
        if names and dataset.name not in names:
            continue
        if not dataset.available:
            found[dataset.name] = f"skipped: {dataset.folder} is not beside the checkout"
            continue
        with tempfile.TemporaryDirectory(prefix="firstfix-bench-") as folder:
            found[dataset.name] = measure(dataset, Path(folder))
    return found


def sections(figures: Mapping[str, Figures | str], lines: Callable[[Figures], list[str]]) -> str:
    """Markdown with a section for each data set of ``measure_each``.

    Args:
        lines: of a section, below its title.
    """
    found = []
    for name, of_one in figures.items():
        said = [of_one] if isinstance(of_one, str) else lines(of_one)
        found.append("\n".join([f"### {name}", "", *said, ""]))
    return "\n".join(found)

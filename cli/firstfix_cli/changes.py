"""Changes of a map as a table, and as a picture from above."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

SEEN = "#dddddd"
_COLOURS = {"gone": "#d73027", "new": "#2166ac", "unmapped": "#e6a700"}
_NOT_TOLD_APART = (
    "new things and parts that were never mapped are not told apart: no query knew where the mapping run saw"
)


def lines_of(found: Mapping[str, Any]) -> list[str]:
    """The answer of ``GET /maps/{id}/changes`` as text, a line for each area."""
    head = f"{found['map_id']}: version {found['version'][:8]}, {found['sightings']:,} queries counted"
    if found["last_time"] is not None:
        head += f", {found['first_time'][:16]} to {found['last_time'][:16]} UTC"
    lines = [head]
    if not found["areas"]:
        return [*lines, "no area is known to have changed, or to be missing in the map"]
    lines.append(
        f"{'kind':8} {'from (m)':>24} {'to (m)':>24} {'cells':>6} {'share':>6} {'spots':>5}  last seen"
    )
    for area in found["areas"]:
        low, high = (" ".join(f"{v:7.1f}" for v in area["box"][end]) for end in ("low", "high"))
        numbers = f"{area['cells']:6} {area['share']:6.2f} {area['spots']:5}"
        lines.append(f"{area['kind']:8} {low:>24} {high:>24} {numbers}  {area['last_seen'][:16]}")
    left_out = found["areas_found"] - len(found["areas"])
    if left_out:
        lines.append(f"and {left_out:,} more")
    if not found["coverage_known"] and any(area["kind"] == "new" for area in found["areas"]):
        lines.append(_NOT_TOLD_APART)
    return lines


def draw_changes(found: Mapping[str, Any], path: Path) -> None:
    """Draw the areas from above, over the cells that were seen.

    Args:
        found: the answer of ``GET /maps/{id}/changes`` with cells and grid.
        path: of the picture; its ending says the format.
    """
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Patch

    edge_m = found["cell_m"]
    figure, axes = plt.subplots(figsize=(9, 9))
    parts = [(SEEN, found["grid"]["cells"])]
    parts += [(_COLOURS[area["kind"]], area["cell_list"]) for area in found["areas"]]
    for colour, cells in parts:
        if not len(cells):
            continue
        low = np.unique(np.asarray(cells)[:, :2], axis=0) * edge_m
        corners = low[:, None] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * edge_m
        axes.add_collection(PolyCollection(list(corners), facecolors=colour, edgecolors="none", alpha=0.8))
    axes.autoscale_view()
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("y (m)")
    axes.set_title(f"{found['map_id']}, version {found['version'][:8]}: {found['sightings']:,} queries")
    names = {**_COLOURS, "seen": SEEN}
    axes.legend(handles=[Patch(color=colour, label=name) for name, colour in names.items()])
    figure.savefig(path, dpi=120, bbox_inches="tight")
    plt.close(figure)

"""The whole suite in order; ``run`` starts it in a process of its own with one thread, as the paper counts.

    firstfix-lab paper [--quick] [--json FILE]

Pictures and a report in Markdown are left in ``build/bench/paper``.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firstfix.engine.config import SearchConfig
from firstfix_lab.checkout import BENCH, ROOT

from .ablation import ablate
from .clusterings import Clusterer
from .compare import compare_engines, compare_methods
from .naive import compare_clustering, compare_descriptor, compare_match
from .pictures import draw_clusters
from .queries import perturbed, templates_themselves
from .report import report
from .scene import make_scene
from .search_time import measure_search_time
from .tables import cascade_table, table_2, table_3

THRESHOLDS_2 = (0.2, 0.3, 0.4, 0.5)
THRESHOLDS_45 = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)


@dataclass(frozen=True)
class Sizes:
    """Sizes of the suite.

    Attributes:
        beside_track_m: templates stand so near to the track.
        own: templates that are asked in Tables IV and V; ``own_exhaustive``: in Tables II and III.
        perturbed: held-out scans.
        registered: of these, the number that go through the whole localizer.
        viewpoints: templates from which the localizer's map is seen.
        naive: templates that the naive reference clusters.
    """

    templates: int
    beside_track_m: float
    own: int
    own_exhaustive: int
    perturbed: int
    registered: int
    viewpoints: int
    naive: int


FULL = Sizes(100_000, 8.0, 20_000, 10_000, 1_000, 200, 100_000, 800)
QUICK = Sizes(2_000, 4.5, 120, 120, 100, 10, 150, 120)


def run(quick: bool) -> dict[str, Any]:
    """All figures, measured in another process whose libraries have one thread."""
    with tempfile.NamedTemporaryFile(suffix=".json") as file:
        command = [
            sys.executable,
            "-m",
            "firstfix_lab.suites.paper.suite",
            "quick" if quick else "full",
            file.name,
        ]
        one_thread = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        subprocess.run(command, check=True, cwd=ROOT, env=os.environ | one_thread)
        return json.loads(Path(file.name).read_text())


def measure(sizes: Sizes, work: Path) -> dict[str, Any]:
    """Every table and picture, on one scene."""
    folder = work / "paper"
    folder.mkdir(parents=True, exist_ok=True)
    scene = make_scene(sizes.templates, sizes.beside_track_m, work)
    own, some = templates_themselves(scene, sizes.own), templates_themselves(scene, sizes.own_exhaustive)
    held_out = perturbed(scene, sizes.perturbed)
    raw = held_out.as_they_come
    clusterer = Clusterer(scene.templates)
    clusterings = [clusterer.with_neighbours(threshold) for threshold in THRESHOLDS_45]
    finest = clusterings[0].clusters
    figures: dict[str, Any] = {
        "sizes": vars(sizes) | {"trajectory": len(scene.trajectory)},
        "costs": {
            "descriptor": compare_descriptor(120_000),
            "pair": compare_match(scene.templates, 200),
            "clustering": compare_clustering(scene.templates, sizes.naive),
            "knn_similarity_s": round(clusterings[0].similarity_s, 2),
            "knn_linkage_s": {c.threshold: round(c.linkage_s, 2) for c in clusterings},
            "knn_representatives_s": {c.threshold: round(c.choice_s, 2) for c in clusterings},
        },
        "table_4": cascade_table("table 4", scene, clusterings, SearchConfig(engine="kdtree"), own, raw),
        "table_5": cascade_table("table 5", scene, clusterings, SearchConfig(engine="lsh_kdtree"), own, raw),
        "engines": compare_engines(scene, finest, some, held_out),
        "methods": compare_methods(scene, finest, held_out, sizes.registered, sizes.viewpoints),
        "ablation": ablate(scene, some, held_out.levelled),
        "figures_4_to_6": draw_clusters(scene.templates, folder),
        "figures_7_and_8": measure_search_time(scene.templates, folder),
        "table_3": table_3(scene, sizes.own_exhaustive, raw),
        "table_2": table_2(scene, clusterer, some, raw, THRESHOLDS_2),
    }
    figures["peak_memory_gb"] = round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6, 2)
    (folder / "report.md").write_text(report(figures))
    return figures


if __name__ == "__main__":
    Path(sys.argv[2]).write_text(json.dumps(measure(FULL if sys.argv[1] == "full" else QUICK, BENCH)))

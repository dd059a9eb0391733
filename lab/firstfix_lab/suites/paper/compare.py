"""Beyond the paper's tables: every search engine in its cascade, and the default method beside it."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.config import EngineOverrides
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import SearchConfig
from firstfix.engine.index import MapIndex, MapView
from firstfix.engine.localizer import Localizer
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.engine.retrieval.cascade import Cascade, Clusters
from firstfix.engine.retrieval.key_search import ENGINES
from firstfix.transform import pose_error
from firstfix_builder.index.views import views_in
from firstfix_builder.index.visible_points import map_surface
from firstfix_builder.templates.fit_engine import fit_engine
from firstfix_builder.viewpoints.even_sample import rows_by_place

from ...common.other_key_searches import OTHERS
from .matching import make_cascade, run_cascade, success
from .published import WITHIN_M
from .queries import Perturbed
from .scene import MAX_RANGE_M, PAPER, SENSOR, SPACING_M, Scene, Taken
from .tables import K

Row = dict[str, Any]
MAP_STEP_M = 0.1
VIEWPOINT_M = 3.0
DEFAULT_SEARCH = SearchConfig()


def compare_engines(scene: Scene, clusters: Clusters, own: Taken, perturbed: Perturbed) -> list[Row]:
    """The same cascade, clusters and K over every engine."""
    rows = []
    for engine in (*ENGINES, *OTHERS):
        cascade = make_cascade(scene.templates, clusters, SearchConfig(), PAPER, engine)
        run = run_cascade(cascade, own.by[PAPER], K)
        rows.append(
            {
                "engine": engine,
                "search_ms": run.search_ms,
                "match_ms": run.match_ms,
                "success": success(scene.templates.position_m[run.found], own.position_m),
                "success_perturbed": _cascade_success(scene, cascade, K, perturbed.levelled, PAPER),
            }
        )
        _print("engine", rows[-1])
    return rows


def compare_methods(
    scene: Scene, clusters: Clusters, perturbed: Perturbed, registered: int, viewpoints: int
) -> list[Row]:
    """Compare the paper's method with the default one: search alone, and the whole localizer.

    Args:
        registered: how many of the scans the localizers are asked.
        viewpoints: how many templates the localizers' map is seen from.
    """
    paper = make_cascade(scene.templates, clusters, SearchConfig(engine="kdtree"), PAPER)
    default = make_cascade(scene.templates, Clusters.alone(len(scene.templates)), DEFAULT_SEARCH, "occupancy")
    cases = (
        ("paper, scan as it comes", paper, K, PAPER, perturbed.as_they_come),
        ("paper, scan levelled", paper, K, PAPER, perturbed.levelled),
        ("default", default, DEFAULT_SEARCH.clusters, "occupancy", perturbed.levelled),
    )
    rows = []
    for name, cascade, count, how, queries in cases:
        run = run_cascade(cascade, queries.by[how], count)
        found_m = scene.templates.position_m[run.found]
        row = {
            "method": name,
            "ms": round(run.search_ms + run.match_ms, 3),
            "success": success(found_m, queries.position_m),
        }
        rows.append(row)
        _print("method", row)
    positions = scene.templates.position_m.astype(np.float64)
    surfaces = _Surfaces(scene, positions[rows_by_place(positions, viewpoints, VIEWPOINT_M)])
    for method, cascade in (("paper", paper), ("default", default)):
        row = _localized(surfaces, method, cascade, perturbed, registered)
        rows.append(row)
        _print("method", row)
    return rows


class _Surfaces:
    """The map's surface for each voxel size. It takes long to make, and both methods use the same."""

    def __init__(self, scene: Scene, positions: NDArray[np.float64]) -> None:
        self._scene = scene
        self._positions = positions
        self._made: dict[float, Surface] = {}

    def of(self, voxel_m: float) -> Surface:
        if voxel_m not in self._made:
            views = views_in(self._scene.simulator, self._positions, SENSOR)
            self._made[voxel_m] = map_surface(None, views, voxel_m)
        return self._made[voxel_m]


def _localized(surfaces: _Surfaces, method: str, cascade: Cascade, perturbed: Perturbed, count: int) -> Row:
    """The best hypothesis after registration, whatever the verdict: there is no calibration here."""
    overrides = EngineOverrides.model_validate({"method": method})
    engine = fit_engine(overrides, SENSOR, MAP_STEP_M, MAX_RANGE_M, SPACING_M, np.eye(4))
    surface = surfaces.of(engine.registration.map_voxel_m)
    view = MapView.of(surface.points, engine.verification.reach_m)
    localizer = Localizer(
        MapIndex(engine, Calibration(), cascade, MapSurface.of(surface, engine.registration), view)
    )
    errors, total_ms = [], []
    for scan, T_map_sensor in perturbed.scans[:count]:
        answer = localizer.localize(scan)
        best = answer.hypotheses[0].T_map_sensor if answer.hypotheses else np.diag([np.inf, 1, 1, 1])
        errors.append(pose_error(T_map_sensor, best)[0] if answer.hypotheses else np.inf)
        total_ms.append(sum(answer.timings_ms.values()))
    return {
        "method": f"{method}, registered",
        "ms": round(float(np.median(total_ms)), 1),
        "success": [round(float(np.mean(np.array(errors) <= limit)), 5) for limit in WITHIN_M],
    }


def _cascade_success(scene: Scene, cascade: Cascade, count: int, queries: Taken, name: str) -> list[float]:
    run = run_cascade(cascade, queries.by[name], count)
    return success(scene.templates.position_m[run.found], queries.position_m)


def _print(table: str, row: Row) -> None:
    print(table, row, file=sys.stderr, flush=True)

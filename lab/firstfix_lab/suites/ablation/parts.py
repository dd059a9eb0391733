"""Parts of the default method, each of which can be taken out alone, on a version as it was built."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.preprocess import PreparedQuery
from firstfix.engine.registration.align import MapSurface, Registrations
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.engine.stopwatch import Stopwatch
from firstfix.engine.with_prior import judging
from tests.reference.hypotheses import HypothesisSearch as PlainHypothesisSearch
from tests.reference.map_search import LocalizerInSteps, MapSearch

FIXED_THRESHOLD = 0.995  # of every map, before each had its own
WIDER = 2  # cells of the step before the coarse alignment, against its own
FEW_ITERATIONS = 12  # of the fine alignment, before it went on until it rests


@dataclass(frozen=True)
class Part:
    """One part of the method.

    Attributes:
        section: of docs/method.md.
        without: a version's index to the same without the part.
        options: of the queries that are asked without it; None: the usual ones.
        is_plain: the search is the plain one, whose steps are those of the index's surface.
    """

    name: str
    section: str
    without: Callable[[MapIndex], MapIndex]
    options: LocalizeOptions | None = None
    is_plain: bool = False

    def localizer(self, index: MapIndex) -> Localizer:
        """Localizer of a version, without the part."""
        return (PlainLocalizer if self.is_plain else Localizer)(self.without(index))


class PlainMapSearch(MapSearch):
    """A map search whose hypotheses are found step by step: the compiled search has no step to replace."""

    def new_hypotheses(self, prior: Prior | None) -> Any:
        """See ``MapSearch.new_hypotheses``."""
        return PlainHypothesisSearch(self._index, self._prepared, prior, self._map_id)


class PlainLocalizer(LocalizerInSteps):
    """A localizer with the plain search."""

    def search(
        self, prepared: PreparedQuery, options: LocalizeOptions, watch: Stopwatch, map_id: str = ""
    ) -> MapSearch:
        """See ``Localizer.search``."""
        return PlainMapSearch(judging(self.index, options), prepared, options, watch, map_id)


class HastySurface(MapSurface):
    """A map whose fine alignments stop after few iterations, and are believed wherever they are then."""

    def align_fine(
        self,
        scan: Surface,
        T_level_sensor: NDArray[np.float64],
        iterations: int = FEW_ITERATIONS,
        *,
        twist: NDArray[np.float64] | None = None,
    ) -> Registrations:
        """See ``MapSurface.align_fine``."""
        found = super().align_fine(scan, T_level_sensor, iterations, twist=twist)
        return replace(found, rests=np.ones(len(found), bool))


@dataclass(frozen=True)
class WideSurface(MapSurface):
    """A map that attracts poses from further away, by a step before the coarse alignment.

    Attributes:
        wide: grid of the map with cells twice as wide as those of the coarse grid.
    """

    wide: SurfaceGrid = field(kw_only=True)

    @classmethod
    def around(cls, surface: MapSurface, points: NDArray[np.float32]) -> WideSurface:
        """Wide surface of the same map.

        Args:
            points: (m, 3) of the map.
        """
        cell_m = WIDER * surface.config.coarse_voxel_m
        thinned = Surface.around(points, two_faces=True).thinned(cell_m / 2)
        return cls(**_fields_of(surface), wide=SurfaceGrid.of(thinned, cell_m))

    def align_coarse(
        self, scan: Surface, T_level_sensor: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """See ``MapSurface.align_coarse``. The step before it has equally many points at every range."""
        cell_m, iterations = float(self.wide.cell.item()), self.config.coarse_iterations
        even = scan.thinned(cell_m).at_most(self.ranking.coarse_points, cell_m)
        angle = self.ranking.coarse_angle
        nearer = self._align(self.wide, even, T_level_sensor, iterations, 1.5 * cell_m, angle)
        return super().align_coarse(scan, nearer.T_level_sensor)


def _as_it_is(index: MapIndex) -> MapIndex:
    return index


def _configured(index: MapIndex, **changes: BaseModel) -> MapIndex:
    return replace(index, config=index.config.model_copy(update=changes))


def _without_local_search(index: MapIndex) -> MapIndex:
    return _configured(index, nearby=index.config.nearby.model_copy(update={"reach_m": 0.0}))


def _searched_once(index: MapIndex) -> MapIndex:
    return _configured(index, search=index.config.search.model_copy(update={"widened": 1}))


def _ranked_without_free_space(index: MapIndex) -> MapIndex:
    weights = dict.fromkeys(("removed_weight", "violation_weight", "seen_free_weight"), 0.0)
    return _configured(index, ranking=index.config.ranking.model_copy(update=weights))


def _with_a_wider_basin(index: MapIndex) -> MapIndex:
    wide = WideSurface.around(index.surface, index.view.near.points)
    return replace(_without_local_search(index), surface=wide)


def _hasty(index: MapIndex) -> MapIndex:
    return replace(index, surface=HastySurface(**_fields_of(index.surface)))


def _fields_of(surface: MapSurface) -> dict[str, Any]:
    return {field.name: getattr(surface, field.name) for field in fields(surface)}


WHOLE = Part("nothing", "7", _as_it_is)
PARTS = (
    WHOLE,
    Part("wider search of unconvincing scans", "7.1", _searched_once),
    Part("local search beside the best place", "7.2", _without_local_search),
    Part("local search, for a wider basin", "7.2", _with_a_wider_basin, is_plain=True),
    Part("alignment until it rests", "7.2", _hasty, is_plain=True),
    Part("known aliases", "7.1", lambda index: replace(index, aliases=None)),
    Part("seen-free space", "7.1", lambda index: replace(index, seen_free=None)),
    Part("free space in the ranking", "7.1", _ranked_without_free_space),
    Part("the map's own threshold", "11", _as_it_is, LocalizeOptions(min_probability=FIXED_THRESHOLD)),
)

"""Candidates: templates that resemble a scan, and the sensor pose that each implies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..answer.options import LocalizeOptions
from ..answer.prior import Prior
from ..descriptor import Described
from ..transform import Matrix
from .index import MapIndex


class LevelledScan(Protocol):
    """The levelled frame of a scan, which the search needs beside its descriptor."""

    @property
    def R_level_sensor(self) -> NDArray[np.float64]:
        """(3, 3) levelling rotation."""
        ...

    @property
    def height_m(self) -> float:
        """Height of the sensor above the floor."""
        ...


@dataclass(frozen=True)
class Candidates:
    """Templates found by the search, with the poses that they imply, most similar first.

    Attributes:
        template: (k,) their rows.
        T_level_sensor: (k, 4, 4) of the query's last scan, from the template's position and the best yaw.
        score: (k,) 0..1, similarity of the two descriptors at that yaw.
    """

    template: NDArray[np.integer]
    T_level_sensor: NDArray[np.float64]
    score: NDArray[np.floating]

    def __len__(self) -> int:
        return len(self.template)

    def at(self, rows: NDArray[np.integer]) -> Candidates:
        """Some of the candidates, in the order of the (m,) given rows."""
        return Candidates(self.template[rows], self.T_level_sensor[rows], self.score[rows])

    @classmethod
    def merged(cls, parts: Sequence[Candidates]) -> Candidates:
        """The candidates of all parts, most similar first. No parts have none."""
        if not parts:
            return cls(np.empty(0, np.int64), np.empty((0, 4, 4)), np.empty(0))
        if len(parts) == 1:
            return parts[0]
        template, T_level_sensor, score = (
            np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(cls)
        )
        return cls(template, T_level_sensor, score).at(np.argsort(-score, kind="stable"))


def find_candidates(
    index: MapIndex, described: Described, scan: LevelledScan, options: LocalizeOptions, effort: int = 1
) -> Candidates:
    """Candidates of one scan that the prior allows, most similar first.

    Compiled: ``native/include/firstfix/query/similar_places.hpp``.

    Args:
        described: descriptor of the scan, by its occupancy.
        effort: factor on the config's numbers of clusters and candidates.
    """
    cascade, search = index.cascade, index.config.search
    found = native.similar_places(
        index.searched,
        cascade.compiled or (lambda *levelling: cascade.finder(described)),
        (scan.R_level_sensor, scan.height_m),
        described["occupancy"][0],
        None if options.prior is None else prior_numbers(options.prior, index),
        options.max_candidates or effort * search.candidates,
        effort * search.clusters,
    )
    return Candidates(*found)


def prior_numbers(prior: Prior, index: MapIndex) -> tuple[Matrix, NDArray[np.float64], float, float, float]:
    """A prior about places of a map, as the compiled search reads it."""
    return index.T_map_level, prior.position_m, prior.radius_m, prior.yaw_deg, prior.yaw_range_deg

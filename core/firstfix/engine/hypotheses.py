"""From candidates of one map to the few poses at which the scan fits it (docs/method.md section 7).

The search is compiled: ``native/include/firstfix/query/search.hpp``.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .. import native
from ..answer.prior import Prior
from ..transform import Matrix
from .candidates import Candidates, prior_numbers
from .index import MapIndex
from .preprocess import PreparedQuery
from .registered_candidate import RegisteredCandidate

NO_POSES = np.empty((0, 4, 4))


class HypothesisSearch:
    """Aligns the candidates of one query in one map and keeps the poses that compete for the answer.

    A later run adds to what the runs before it found, and repeats none of their work.
    """

    def __init__(
        self, index: MapIndex, prepared: PreparedQuery, prior: Prior | None = None, map_id: str = ""
    ) -> None:
        self._index, self._map_id = index, map_id
        self._spots = prepared.compiled.spots
        allowed = None if prior is None else prior_numbers(prior, index)
        self._search = native.Search(index.searched, prepared.compiled, allowed)

    def run(
        self,
        candidates: Candidates,
        twist: NDArray[np.float64] | None = None,
        aliases: NDArray[np.float64] = NO_POSES,
        *,
        nearby: bool = False,
    ) -> list[RegisteredCandidate]:
        """Distinct poses that the prior allows, best first: of these candidates and of all earlier runs.

        Only the best and its close rivals are aligned finely, and only if the best may still be accepted.

        Args:
            twist: (6,) motion of the scan where these candidates come from; None: not known.
            aliases: (k, 4, 4) known aliases of the best pose.
            nearby: the best pose moves to a better minimum beside it, if there is one.
        """
        found = self._search.run(*_rows(candidates), twist, aliases, nearby)
        return RegisteredCandidate.found(self._index, self._map_id, self._spots, found)

    def not_far_behind(
        self, aliases: Candidates, T_level_sensor: Matrix, twist: NDArray[np.float64] | None = None
    ) -> Candidates:
        """The few aliases of a pose at which a probe finds the scan to fit nearly as well.

        Args:
            T_level_sensor: (4, 4) the pose.
            twist: as for ``run``.
        """
        return aliases.at(self._search.not_far_behind(aliases.T_level_sensor, T_level_sensor, twist))


def _rows(
    candidates: Candidates,
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    template, score = candidates.template.astype(np.int64), candidates.score.astype(np.float64)
    return template, candidates.T_level_sensor, score

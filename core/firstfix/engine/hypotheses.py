"""From candidates of one map to the few poses at which the scan fits it (docs/method.md section 7)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from ..answer.prior import Prior
from .candidates import Candidates
from .index import MapIndex
from .preprocess import PreparedQuery
from .registered_candidate import RegisteredCandidate, distinct, features_of, ranked

RIVAL_WITHIN = 0.15  # of the best candidate's support
MAX_REFINED = 3
NEIGHBOUR_M = 0.3  # to the minima beside the right one: the next panel, a wall's other face
_BESIDE_M = NEIGHBOUR_M * np.array(list(product((0, -1, 1), repeat=2)))  # (9, 2), itself first
BETTER_BY = 0.02  # of alignment_score: a scan distorted by motion has several minima nearly as good
MAYBE_BETTER_BY = 0.01  # the same, measured with few points
PROMISING = 0.02  # probability before fine alignment, which raises the inlier ratio a little


class HypothesisSearch:
    """Aligns the candidates of one query in one map and keeps the poses that compete for the answer."""

    def __init__(
        self, index: MapIndex, prepared: PreparedQuery, prior: Prior | None = None, map_id: str = ""
    ) -> None:
        self._index, self._prepared, self._prior, self._map_id = index, prepared, prior, map_id

    def run(self, candidates: Candidates) -> list[RegisteredCandidate]:
        """Distinct poses that the prior allows, best first.

        Only the best and its close rivals are aligned finely, and only if the best may still be accepted.
        """
        if not len(candidates):
            return []
        checked = ranked(self._check_free_space(self._register(candidates)))
        if not checked or not self._may_be_accepted(checked):
            return checked
        return ranked(self._allowed(self._refine(checked)))

    def _register(self, candidates: Candidates) -> list[RegisteredCandidate]:
        """Aligns all candidates with few points: coarsely, then on the map's own points.

        Returns the best ones that may compete: distinct poses that the prior allows, best first.
        """
        surface, sparse = self._index.surface, self._prepared.sparse
        aligned = surface.align(sparse, surface.align_coarse(sparse, candidates.T_level_sensor))
        rows = np.argsort(-aligned.alignment_score, kind="stable")
        if self._prior is not None:
            rows = rows[self._prior.allows_each(self._index.T_map_level @ aligned.T_level_sensor[rows])]
        first = distinct(aligned.T_level_sensor[rows], most=self._index.config.verification.compared)
        spots = self._prepared.spots
        return [
            RegisteredCandidate(
                self._index, self._map_id, int(candidates.template[row]), aligned[row], spots=spots
            )
            for row in rows[first].tolist()
        ]

    def _allowed(self, registered: Iterable[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """The candidates that the prior allows."""
        prior = self._prior
        return [one for one in registered if prior is None or prior.allows(one.T_map_sensor)]

    def _check_free_space(self, registered: Sequence[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """The candidates that may be the best or its best rival, with their free-space violation.

        The check only lowers support, so it stops at the first candidate that is too weak already.
        """
        checked: list[RegisteredCandidate] = []
        for candidate in registered:
            supports = sorted((other.quality.support for other in checked), reverse=True)
            if len(supports) > 1 and candidate.quality.support < min(supports[1], supports[0] - RIVAL_WITHIN):
                break
            checked.append(self._with_free_space(candidate))
        return checked

    def _may_be_accepted(self, checked: Sequence[RegisteredCandidate]) -> bool:
        """Returns whether fine alignment is worth its time. Always so while the calibration is the prior."""
        calibration = self._index.calibration
        return not calibration.cases or calibration.probability(features_of(checked)) >= PROMISING

    def _refine(self, checked: Sequence[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """The candidates, the best and its close rivals aligned again with many points.

        A rival that is a little worse may only have been aligned worse: it gets the same chance.
        """
        close = checked[0].quality.support - RIVAL_WITHIN
        near = [candidate for candidate in checked if candidate.quality.support > close][:MAX_REFINED]
        aligned = self._index.surface.align_fine(self._prepared.dense, self._best_minima_near(near))
        refined = (
            self._with_free_space(replace(candidate, registration=registration))
            for candidate, registration in zip(near, aligned, strict=True)
        )
        return [*refined, *checked[len(near) :]]

    def _best_minima_near(self, candidates: Sequence[RegisteredCandidate]) -> NDArray[np.float64]:
        """Each candidate's pose, or one beside it that is clearly better, aligned smoothly: (k, 4, 4)."""
        surface, count = self._index.surface, len(candidates)
        starts = np.array([[one.registration.T_level_sensor] * len(_BESIDE_M) for one in candidates])
        starts[..., :2, 3] += _BESIDE_M
        aligned = surface.align(self._prepared.sparse, starts.reshape(-1, 4, 4))
        T, score = aligned.T_level_sensor.reshape(starts.shape), aligned.alignment_score.reshape(count, -1)
        beside = 1 + score[:, 1:].argmax(axis=1)  # the first column is the pose itself
        rivalled = np.flatnonzero(score.max(axis=1) > score[:, 0] + MAYBE_BETTER_BY)
        # few points may mistake which is better, and by how much: many points decide
        both = np.concatenate([T[:, 0], T[rivalled, beside[rivalled]]])
        smooth = surface.align_smoothly(self._prepared.dense, both)
        own, other = smooth.alignment_score[:count], smooth.alignment_score[count:]
        is_better = other > own[rivalled] + BETTER_BY
        best = np.arange(count)
        best[rivalled[is_better]] = count + np.flatnonzero(is_better)
        return smooth.T_level_sensor[best]

    def _with_free_space(self, candidate: RegisteredCandidate) -> RegisteredCandidate:
        """The candidate with its free-space violation, averaged over the query's scans."""
        T_level_last = candidate.registration.T_level_sensor
        violations = [
            self._index.view.free_space_violation(scan.view, T_level_last @ scan.T_last_scan)
            for scan in self._prepared.scans
        ]
        return replace(candidate, free_space_violation=sum(violations) / len(violations))

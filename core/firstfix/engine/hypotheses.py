"""From candidates of one map to the few poses at which the scan fits it (docs/method.md section 7)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from ..answer.prior import Prior
from .candidates import Candidates
from .index import MapIndex
from .preprocess import PreparedQuery
from .registered_candidate import RegisteredCandidate, features_of, ranked
from .registration.align import Registration

RIVAL_WITHIN = 0.15  # of the best candidate's support
MAX_REFINED = 3
NEIGHBOUR_M = 0.3  # to the minima beside the right one: the next panel, a wall's other face
BETTER_BY = 0.02  # of alignment_score: a scan distorted by motion has several minima nearly as good
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
        registered = self._rank(self._register(candidates))
        checked = self._rank(self._check_free_space(registered))
        if not checked or not self._may_be_accepted(checked):
            return checked
        return self._rank(self._refine(checked))

    def _register(self, candidates: Candidates) -> list[RegisteredCandidate]:
        """Aligns all candidates with few points: coarsely, then on the map's own points."""
        surface, sparse = self._index.surface, self._prepared.sparse
        aligned = surface.align(sparse, surface.align_coarse(sparse, candidates.T_level_sensor))
        return [
            RegisteredCandidate(self._index, self._map_id, template, registration)
            for template, registration in zip(candidates.template.tolist(), aligned, strict=True)
        ]

    def _rank(self, registered: Iterable[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """Distinct candidates that the prior allows, best first."""
        prior = self._prior
        return ranked(one for one in registered if prior is None or prior.allows(one.T_map_sensor))

    def _check_free_space(self, registered: Sequence[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """The candidates that may be the best or its best rival, with their free-space violation.

        The check only lowers support, so it stops at the first candidate that is too weak already.
        """
        checked: list[RegisteredCandidate] = []
        for candidate in registered[: self._index.config.verification.compared]:
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
        starts = np.array([self._best_minimum_near(candidate).T_level_sensor for candidate in near])
        aligned = self._index.surface.align_fine(self._prepared.dense, starts)
        refined = (
            self._with_free_space(replace(candidate, registration=registration))
            for candidate, registration in zip(near, aligned, strict=True)
        )
        return [*refined, *checked[len(near) :]]

    def _best_minimum_near(self, candidate: RegisteredCandidate) -> Registration:
        """The candidate's registration, or one beside it that is clearly better."""
        starts = np.repeat(candidate.registration.T_level_sensor[None], 9, axis=0)
        starts[:, :2, 3] += NEIGHBOUR_M * np.array(list(product((0, -1, 1), repeat=2)))
        own, *beside = self._index.surface.align(self._prepared.sparse, starts)
        best = max(beside, key=lambda registration: registration.alignment_score)
        return best if best.alignment_score > own.alignment_score + BETTER_BY else own

    def _with_free_space(self, candidate: RegisteredCandidate) -> RegisteredCandidate:
        """The candidate with its free-space violation, averaged over the query's scans."""
        T_level_last = candidate.registration.T_level_sensor
        violations = [
            self._index.view.free_space_violation(scan.view, T_level_last @ scan.T_last_scan)
            for scan in self._prepared.scans
        ]
        return replace(candidate, free_space_violation=sum(violations) / len(violations))

"""From candidates of one map to the few poses at which the scan fits it, in NumPy and kernel by kernel.

``native.Search`` is held against it, and an ablation may change a step of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import fields, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.engine.candidates import Candidates
from firstfix.engine.index import FreeSpaceShares, MapIndex
from firstfix.engine.preprocess import PreparedQuery
from firstfix.engine.registered_candidate import (
    NOT_CHECKED,
    NOT_MEASURED,
    RegisteredCandidate,
)
from firstfix.engine.registration.align import Agreement, Registration, Registrations
from firstfix.engine.registration.surface import Surface
from firstfix.transform import Matrix
from tests.reference.distinct import distinct
from tests.reference.known_aliases import is_any_of, is_stacked, may_tie, not_far_behind, rivals_among
from tests.reference.local_search import best_near, offsets_along, offsets_around
from tests.reference.look_alikes import with_look_alikes_marked
from tests.reference.motion_at_places import MotionAtPlaces, together
from tests.reference.template_places import known_aliases
from tests.reference.verdict import BLUR, MEASURED_FINELY, features_of, threshold_at

# Share of a search's best coarse alignment score, below which a candidate is hopeless. The right place had
# 0.905 or more in 729 searches (lab/docs/experiments.md, "Hopeless candidates").
_HOPEFUL_FROM = 0.85
# Alignment score from which on a place explains a scan so well that hopeless ones are no rivals. A scan that
# no place explains needs them: they tell that it is of another place.
_EXPLAINED_FROM = 0.85
HOPELESS_BELOW = 0.01  # probability; its rivals could not move it by more
_MAY_BE_SURE = (
    0.5  # probability that a pose has at most, from which on it may be sure once it is aligned finely
)
_ENOUGH_UNSURE = 12  # poses: where none of so many may be sure, those that fit worse are no answer either
_REFINED_BY = 0.15  # by which fine alignment may raise the inlier ratio
NO_POSES = np.empty((0, 4, 4))
_BESIDE = np.array(list(product((0, -1, 1), repeat=2)))  # (9, 2), itself first


class HypothesisSearch:
    """Aligns the candidates of one query in one map and keeps the poses that compete for the answer."""

    def __init__(
        self, index: MapIndex, prepared: PreparedQuery, prior: Prior | None = None, map_id: str = ""
    ) -> None:
        self._index, self._prepared, self._prior, self._map_id = index, prepared, prior, map_id
        self._ranking = index.config.ranking
        self._tried = np.empty((0, 4, 4))  # all starts
        self._starts = np.empty((0, 4, 4))  # of those that were aligned
        self._twist_start = np.empty((0, 6))  # by which the scan was deskewed then; 0: it was not
        self._template = np.empty(0, np.int64)
        self._aligned: list[Registrations] = []  # batch by batch
        self._in_motion = (
            None
            if prepared.sparse.time_s is None
            else MotionAtPlaces(index.surface, prepared.sparse, _HOPEFUL_FROM)
        )
        self._free_space: dict[bytes, FreeSpaceShares] = {}  # by pose: a later run does not check it again
        self._agreement: dict[bytes, Agreement] = {}  # the same, of the few points
        self._beside: dict[bytes, RegisteredCandidate | None] = {}  # by pose: the better one beside it
        self._unchecked: list[RegisteredCandidate] = []  # of the last run
        self.found: list[RegisteredCandidate] = []  # by the last run

    def run(
        self,
        candidates: Candidates,
        twist: NDArray[np.float64] | None = None,
        aliases: NDArray[np.float64] = NO_POSES,
        *,
        nearby: bool = False,
    ) -> list[RegisteredCandidate]:
        """See ``firstfix.engine.hypotheses.HypothesisSearch``."""
        self.align(candidates, twist)
        checked = self._registered()
        if len(aliases) or not self._is_alone_and_good(checked):
            checked = ranked(self._check_free_space(checked, aliases))
        if not checked or not self._may_be_accepted(checked):
            self.found = self._with_agreements(checked)
        else:
            self.found = self._finely_measured(self._refine(checked))
        if nearby and self.found and self._may_be_accepted(self.found):
            config = self._index.config.nearby
            best = self.found[0].registration
            offsets_m = offsets_along(config, best) if self.is_settled else offsets_around(config)
            if len(offsets_m):
                self.found = self.search_near(self.found, offsets_m)
        return self.found

    def align(self, candidates: Candidates, twist: NDArray[np.float64] | None = None) -> None:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        self._align(self.untried(candidates, twist), twist)

    @property
    def may_explain_scan(self) -> bool:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        if self._in_motion is not None or not self._index.calibration.cases:
            return True
        least = self._ranking.convincing_inlier_ratio - _REFINED_BY
        near = [one for one in self._registered() if one.quality.inlier_ratio >= least]
        return any(self._most(one) >= _MAY_BE_SURE for one in self._with_agreements(near))

    def _most(self, one: RegisteredCandidate) -> float:
        """The probability that a candidate has at most, whatever its rivals."""
        alone = features_of([one]).without_rivals
        return max(self._index.calibration.probability(replace(alone, tied=tied)) for tied in (1, 2))

    @property
    def is_settled(self) -> bool:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        calibration = self._index.calibration
        return (
            bool(self.found)
            and self.found[0].registration.rests
            and calibration.ends_search(features_of(self.found))
        )

    @property
    def explains_scan(self) -> bool:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        if not self.found:
            return False
        best = features_of(self.found)
        is_convincing = best.quality.inlier_ratio >= best.ranking.convincing_inlier_ratio
        return is_convincing and self._index.calibration.ends_search(best.without_rivals)

    def is_accepted(self, min_probability: float | None) -> bool:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        if not self.found:
            return False
        return self._index.calibration.accepts(features_of(self.found), self._needed(min_probability))

    def try_aliases(self, min_probability: float | None, *, nearby: bool) -> list[tuple[str, float]]:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        placed = self.found[0].registration
        aliases = known_aliases(self._index, placed.T_level_sensor, self._prior)
        untried = self.untried(aliases, placed.twist)
        needed = self._needed(min_probability)
        rivals = rivals_among(untried, self.found[0], self._prepared.sparse, needed)
        if len(rivals) or self.leaves_out(aliases.T_level_sensor):
            self.run(rivals, placed.twist, aliases.T_level_sensor, nearby=nearby)
        return []

    def _needed(self, min_probability: float | None) -> float | None:
        return threshold_at(self.found[0], LocalizeOptions(min_probability=min_probability))

    def with_look_alikes_marked(self) -> list[RegisteredCandidate]:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        self.found = with_look_alikes_marked(self.found, self._prior)
        return self.found

    def aliases_outside(self) -> Candidates:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        assert self._prior is not None
        placed = self.found[0].registration
        found = known_aliases(self._index, placed.T_level_sensor, None)
        is_outside = ~self._prior.allows_each(self._index.T_map_level @ found.T_level_sensor)
        return self.not_far_behind(found.at(np.flatnonzero(is_outside)), placed.T_level_sensor, placed.twist)

    def lead_outside(self, anywhere: HypothesisSearch) -> float:
        """See ``tests.reference.hypothesis_steps.HypothesisSteps``."""
        assert self._prior is not None
        outside = [one.support for one in anywhere.found if not self._prior.allows(one.T_map_sensor)]
        return max(0.0, max(outside) - self.found[0].support) if outside else 0.0

    def not_far_behind(
        self,
        aliases: Candidates,
        T_level_sensor: NDArray[np.float64],
        twist: NDArray[np.float64] | None = None,
    ) -> Candidates:
        """See ``firstfix.engine.hypotheses.HypothesisSearch``."""
        return not_far_behind(self._index, aliases, T_level_sensor, self._prepared.sparse.deskewed(twist))

    def search_near(
        self, found: Sequence[RegisteredCandidate], offsets_m: NDArray[np.float64]
    ) -> list[RegisteredCandidate]:
        """The poses that ``run`` found, best first. The first one moves to a better minimum beside it.

        Free space does not choose between the two: they are one place, seen from nearly the same spot.

        Args:
            offsets_m: see ``best_near``.
        """
        pose = found[0].registration.T_level_sensor.tobytes()
        if pose not in self._beside:
            registration = best_near(
                self._index.surface,
                self._prepared,
                found[0].registration,
                offsets_m,
                self._index.config.nearby,
            )
            self._beside[pose] = (
                None
                if registration is None
                else replace(
                    found[0], registration=registration, free_space=NOT_CHECKED, agreement=NOT_MEASURED
                )
            )
        beside = self._beside[pose]
        if beside is None or not self._allowed([beside]):
            return list(found)
        return self._finely_measured([self._with_free_space(beside), *found[1:]])

    def _finely_measured(self, registered: Iterable[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """The candidates that the prior allows, best first.

        The agreement of the best one, and of those that may tie with it, is measured with many points.
        """
        best_first = ranked(self._allowed(registered))
        reach = self._index.calibration.min_margin + BLUR
        finely = [
            number == 0 or (number < MEASURED_FINELY and best_first[0].support - one.support < reach)
            for number, one in enumerate(best_first)
        ]
        places = [one.registration for one, is_asked in zip(best_first, finely, strict=True) if is_asked]
        agreements = iter(self._agreements(self._prepared.dense, places))
        measured = [
            replace(one, agreement=next(agreements)) if is_asked else one
            for one, is_asked in zip(best_first, finely, strict=True)
        ]
        return self._with_agreements(measured)

    def leaves_out(self, aliases: NDArray[np.float64]) -> bool:
        """See ``firstfix.engine.hypotheses.HypothesisSearch``."""
        return bool(self._tied_aliases(self.found[0], aliases))

    def untried(self, candidates: Candidates, twist: NDArray[np.float64] | None = None) -> Candidates:
        """The candidates that start near no start, and no aligned pose, of an earlier run.

        Args:
            twist: as for ``run``.
        """
        return candidates.at(self._untried(candidates.T_level_sensor, twist))

    def _registered(self) -> list[RegisteredCandidate]:
        """The best ones that may compete, of all runs: distinct poses that the prior allows, best first."""
        if not self._aligned:
            return []
        aligned = _together(self._aligned)
        rows = np.argsort(-aligned.alignment_score, kind="stable")
        if self._prior is not None:
            rows = rows[self._prior.allows_each(self._index.T_map_level @ aligned.T_level_sensor[rows])]
        rows = rows[
            distinct(
                aligned.T_level_sensor[rows], self._ranking, most=self._index.config.verification.compared
            )
        ]
        spots = spots_of([one.T_last_scan for one in self._prepared.scans], self._ranking.spots_apart_m)
        registered = [
            RegisteredCandidate(
                self._index,
                self._map_id,
                int(self._template[row]),
                registration,
                start_z_m=float(self._starts[row, 2, 3]),
                spots=spots,
            )
            for row, registration in zip(rows.tolist(), self._with_motion(aligned, rows), strict=True)
        ]
        registered += self._allowed(one for one in self._beside.values() if one is not None)
        # the motion may have changed the order, an unlikely one counts against a place, and so does meeting
        # little of the map
        registered.sort(key=lambda one: -one.support)
        return registered

    def _align(self, candidates: Candidates, twist: NDArray[np.float64] | None) -> None:
        """Align candidates with few points: coarsely, then the good ones on the map's own points."""
        if not len(candidates):
            return
        surface, T = self._index.surface, candidates.T_level_sensor
        sparse = self._prepared.sparse.deskewed(twist)
        near, score = surface.align_coarse(sparse, T)
        self._tried = np.concatenate([self._tried, T])
        is_hopeful = score >= _HOPEFUL_FROM * score.max()
        for rows in (np.flatnonzero(is_hopeful), np.flatnonzero(~is_hopeful)):
            if not len(rows):
                return
            self._starts = np.concatenate([self._starts, T[rows]])
            known = np.tile(np.zeros(6) if twist is None else twist, (len(rows), 1))
            self._twist_start = np.concatenate([self._twist_start, known])
            self._template = np.concatenate([self._template, candidates.template[rows]])
            self._aligned.append(surface.align(sparse, near[rows]))
            if self._aligned[-1].alignment_score.max() >= _EXPLAINED_FROM:
                return

    def _untried(
        self, T_level_sensor: NDArray[np.float64], twist: NDArray[np.float64] | None
    ) -> NDArray[np.intp]:
        """Rows of (k, 4, 4) starts that are near no start, and no aligned pose, of an earlier run.

        With a motion, starts are where the sensor would be, and not where the skewed scan would lie.
        """
        if not self._aligned:
            return np.arange(len(T_level_sensor))
        if twist is None or self._in_motion is None:
            known = np.concatenate([self._tried, *(part.T_level_sensor for part in self._aligned)])
        else:
            known = self._in_motion.T_level_sensor
        off_m = np.linalg.norm(T_level_sensor[:, None, :3, 3] - known[None, :, :3, 3], axis=2)
        trace = np.einsum("kij,nij->kn", T_level_sensor[:, :3, :3], known[:, :3, :3])
        same_cosine = math.cos(math.radians(self._ranking.same_start_deg))
        is_known = (off_m < self._ranking.same_start_m) & (trace > 1 + 2 * same_cosine)
        return np.flatnonzero(~is_known.any(axis=1))

    def _with_motion(self, aligned: Registrations, rows: NDArray[np.integer]) -> Iterable[Registration]:
        """The given rows, with the motion during the scan where the times of its points are known.

        Wrong places gain by it as well as the right one, so all that are compared get it.
        """
        if self._in_motion is None:
            return (aligned[row] for row in rows.tolist())
        return self._in_motion.solve(aligned, self._twist_start, rows)

    def _allowed(self, registered: Iterable[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """The candidates that the prior allows."""
        prior = self._prior
        return [one for one in registered if prior is None or prior.allows(one.T_map_sensor)]

    def _check_free_space(
        self, registered: Sequence[RegisteredCandidate], aliases: NDArray[np.float64]
    ) -> list[RegisteredCandidate]:
        """The candidates that may be the best or its best rival, with their free space checked.

        The check only lowers support. So it stops at the first candidate that is too weak already, or that
        could not keep the best one from being accepted, or where enough are unsure. Those that are surely
        outdone are left out. Known aliases of the best one tie sooner: of what is left they are checked, too.

        Args:
            registered: in the order of the support that they have at most.
        """
        checked: list[RegisteredCandidate] = []
        self._unchecked = []
        for number, candidate in enumerate(registered):
            if len(checked) > 1:
                checked[:1] = self._with_agreements(checked[:1])
                if self._is_settled(checked, candidate):
                    self._unchecked += registered[number:]
                    break
            if candidate.registration.T_level_sensor.tobytes() not in self._free_space and (
                self._are_unsure(checked) or self._is_outdone(checked, candidate)
            ):
                self._unchecked.append(candidate)
                continue
            checked.append(self._with_free_space(candidate))
            checked.sort(key=lambda one: -one.support)
        if checked:
            checked += map(self._with_free_space, self._tied_aliases(checked[0], aliases))
        checked[:1] = self._with_agreements(checked[:1])
        return checked

    def _are_unsure(self, checked: Sequence[RegisteredCandidate]) -> bool:
        """Whether so many candidates are no answer that none of the following ones is."""
        if len(checked) < _ENOUGH_UNSURE or not self._index.calibration.cases:
            return False
        if checked[0].registration.twist is not None:
            return False
        return all(self._most(one) < _MAY_BE_SURE for one in self._with_agreements(checked))

    def _is_outdone(self, checked: Sequence[RegisteredCandidate], one: RegisteredCandidate) -> bool:
        """Whether a candidate is surely behind all that are refined, the last of which does not tie.

        Args:
            checked: best first.
        """
        refined, calibration = self._ranking.max_refined, self._index.calibration
        if len(checked) < refined:
            return False
        best, last = checked[0], checked[refined - 1]
        at_m, other_m = (each.registration.T_level_sensor[:3, 3] for each in (best, one))
        if best.registration.is_in_motion or bool(is_stacked(at_m, other_m[None])[0]):
            return False
        tie = max(calibration.min_margin, calibration.alias_margin)
        seen_free = FreeSpaceShares(0.0, 0.0, self._seen_free(one.registration))
        return best.support - last.support > tie and replace(one, free_space=seen_free).support < last.support

    def _is_settled(self, checked: Sequence[RegisteredCandidate], following: RegisteredCandidate) -> bool:
        """Whether no candidate from the following one on can change the answer, but known aliases.

        Args:
            checked: best first.
        """
        supports = [other.support for other in checked]
        if following.support < min(supports[1], supports[0] - self._ranking.rival_within):
            return True
        calibration = self._index.calibration
        is_hopeless = calibration.cases and self._most(checked[0]) < min(
            HOPELESS_BELOW, self._ranking.promising
        )
        if is_hopeless and following.support < supports[0]:
            return True
        return calibration.ends_search(features_of([*checked, following]))

    def _tied_aliases(
        self, best: RegisteredCandidate, aliases: NDArray[np.float64]
    ) -> list[RegisteredCandidate]:
        """The unchecked candidates at (k, 4, 4) known aliases of the best one, near enough to it to tie."""
        near = [one for one in self._unchecked if may_tie(best, one)]
        if not near or not len(aliases):
            return []
        at = is_any_of(aliases, np.array([one.registration.T_level_sensor for one in near]), self._ranking)
        return [one for one, is_alias in zip(near, at.tolist(), strict=True) if is_alias]

    def _is_alone_and_good(self, registered: Sequence[RegisteredCandidate]) -> bool:
        """Whether there is one candidate, worth its refinement: its free space is checked after it."""
        return len(registered) == 1 and self._may_be_accepted(self._with_agreements(registered))

    def _may_be_accepted(self, checked: Sequence[RegisteredCandidate]) -> bool:
        """Whether fine alignment is worth its time. Always so while the calibration is the prior."""
        calibration = self._index.calibration
        return (
            not calibration.cases or calibration.probability(features_of(checked)) >= self._ranking.promising
        )

    def _refine(self, checked: Sequence[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """The candidates, the best and its close rivals aligned again with many points.

        A rival that is a little worse may only have been aligned worse: it gets the same chance.
        """
        close = checked[0].support - self._ranking.rival_within
        near = [candidate for candidate in checked if candidate.support > close][: self._ranking.max_refined]
        T_level_sensor, twist = self._best_minima_near(near), together(one.registration for one in near)
        aligned = self._index.surface.align_fine(self._prepared.dense, T_level_sensor, twist=twist)
        refined = (
            self._with_free_space(replace(candidate, registration=registration, agreement=NOT_MEASURED))
            for candidate, registration in zip(near, aligned, strict=True)
        )
        return [*refined, *checked[len(near) :]]

    def _best_minima_near(self, candidates: Sequence[RegisteredCandidate]) -> NDArray[np.float64]:
        """Each candidate's pose, or one beside it that is clearly better, aligned smoothly: (k, 4, 4).

        One beside a pose that slid up or down is on the floor again. A scan in motion is compared as each
        candidate's own motion deskews it: a skewed one fits best where it is askew.
        """
        sparse, dense = self._prepared.sparse, self._prepared.dense
        if self._in_motion is None:
            return self._best_minima(candidates, sparse, dense)
        return np.concatenate(
            [
                self._best_minima([one], sparse.deskewed(twist), dense.deskewed(twist))
                for one in candidates
                for twist in [one.registration.twist]
            ]
        )

    def _best_minima(
        self, candidates: Sequence[RegisteredCandidate], sparse: Surface, dense: Surface
    ) -> NDArray[np.float64]:
        surface, count = self._index.surface, len(candidates)
        risen_m = np.array([one.start_z_m - one.registration.T_level_sensor[2, 3] for one in candidates])
        slid = np.abs(risen_m) > self._ranking.slid_m
        number = len(_BESIDE) + int(slid.any())
        starts = np.array([one.registration.T_level_sensor for one in candidates])[:, None]
        starts = starts.repeat(number, axis=1)  # (k, starts of each, 4, 4)
        starts[:, : len(_BESIDE), :2, 3] += self._ranking.neighbour_m * _BESIDE
        starts[slid, -1, 2, 3] += risen_m[slid]
        aligned = surface.align(sparse, starts.reshape(-1, 4, 4))
        T, score = aligned.T_level_sensor.reshape(starts.shape), aligned.alignment_score.reshape(count, -1)
        beside = 1 + score[:, 1:].argmax(axis=1)  # the first column is the pose itself
        rivalled = np.flatnonzero(score.max(axis=1) > score[:, 0] + self._ranking.maybe_better_by)
        # few points may mistake which is better, and by how much: many points decide
        both = np.concatenate([T[:, 0], T[rivalled, beside[rivalled]]])
        smooth = surface.align_smoothly(dense, both)
        own, other = smooth.alignment_score[:count], smooth.alignment_score[count:]
        is_better = other > own[rivalled] + self._ranking.better_by
        best = np.arange(count)
        best[rivalled[is_better]] = count + np.flatnonzero(is_better)
        return smooth.T_level_sensor[best]

    def _with_agreements(self, candidates: Sequence[RegisteredCandidate]) -> list[RegisteredCandidate]:
        """The candidates with how the few points agree with the map there, measured where it was not yet."""
        keys = [candidate.registration.T_level_sensor.tobytes() for candidate in candidates]
        missing = [
            (key, one.registration)
            for key, one in zip(keys, candidates, strict=True)
            if one.agreement is NOT_MEASURED and key not in self._agreement
        ]
        if missing:
            found = self._agreements(self._prepared.sparse, [registration for _, registration in missing])
            self._agreement.update(zip((key for key, _ in missing), found, strict=True))
        return [
            replace(one, agreement=self._agreement[key]) if one.agreement is NOT_MEASURED else one
            for key, one in zip(keys, candidates, strict=True)
        ]

    def _agreements(self, scan: Surface, registrations: Sequence[Registration]) -> list[Agreement]:
        """Agreement of the scan, deskewed by each registration's own motion, with the map there."""
        surface = self._index.surface
        if scan.time_s is None:
            T_level_sensor = np.array([one.T_level_sensor for one in registrations])
            return surface.agreements(scan, T_level_sensor.reshape(-1, 4, 4))
        return [
            surface.agreements(scan.deskewed(one.twist), one.T_level_sensor[None])[0] for one in registrations
        ]

    def _with_free_space(self, candidate: RegisteredCandidate) -> RegisteredCandidate:
        """The candidate with the shares of directions that pass through the map, over the query's scans."""
        T_level_last, twist = candidate.registration.T_level_sensor, candidate.registration.twist
        pose = T_level_last.tobytes()
        if pose not in self._free_space:
            surface, view = self._index.surface, self._index.view
            shares = _mean(
                [
                    view.seen_through(surface, scan.view_deskewed(twist), T_level_last @ scan.T_last_scan)
                    for scan in self._prepared.scans
                ]
            )
            self._free_space[pose] = FreeSpaceShares(
                shares.free_space_violation,
                shares.removed_surface,
                self._seen_free(candidate.registration),
            )
        return replace(candidate, free_space=self._free_space[pose])

    def _seen_free(self, registration: Registration) -> float | None:
        """Share of the few points, of all scans, in space that the mapping run saw free; None: not known."""
        seen_free = self._index.seen_free
        if seen_free is None:
            return None
        scan = self._prepared.sparse.deskewed(registration.twist)
        return float(seen_free.shares(scan.points, registration.T_level_sensor[None])[0])


def ranked(candidates: Sequence[RegisteredCandidate]) -> list[RegisteredCandidate]:
    """Candidates of one map by support, best first; of nearly the same pose only the best is kept."""
    best_first = sorted(candidates, key=lambda candidate: -candidate.support)
    if not best_first:
        return []
    T_level_sensor = np.array([candidate.registration.T_level_sensor for candidate in best_first])
    rows = distinct(T_level_sensor, best_first[0].index.config.ranking)
    return [best_first[row] for row in rows.tolist()]


def _together(parts: Sequence[Registrations]) -> Registrations:
    """Registrations of all parts, in order. None of them has a twist."""
    names = [field.name for field in fields(Registrations) if field.name != "twist"]
    return Registrations(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _mean(shares: Sequence[FreeSpaceShares]) -> FreeSpaceShares:
    """Mean over several scans, at least one."""
    count = len(shares)
    return FreeSpaceShares(
        sum(one.free_space_violation for one in shares) / count,
        sum(one.removed_surface for one in shares) / count,
    )


def spots_of(T_last_scan: Iterable[Matrix], apart_m: float) -> int:
    """Number of spots, ``apart_m`` apart, where scans of these (4, 4) poses were taken."""
    chosen: list[NDArray[np.float64]] = []
    for T in T_last_scan:
        if all(float(np.linalg.norm(T[:3, 3] - other)) >= apart_m for other in chosen):
            chosen.append(T[:3, 3])
    return len(chosen)

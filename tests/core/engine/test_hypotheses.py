"""Steps of the hypothesis search, on a map whose alignments and free space are made up."""

from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np

from firstfix.answer.prior import Prior
from firstfix.engine.calibration import Calibration
from firstfix.engine.candidates import Candidates
from firstfix.engine.config import EngineConfig
from firstfix.engine.index import FreeSpaceShares, MapIndex
from firstfix.engine.ranking import RANKING
from firstfix.engine.registration.align import Agreement, Registrations
from firstfix.transform import make_transform, rotation_z
from tests.reference.hypotheses import HypothesisSearch

APART_M = 10.0  # candidate i stands at x = 10 i
NEVER_SURE = Calibration(bias=-100)
SCAN = SimpleNamespace(view_deskewed=lambda twist: twist, T_last_scan=np.eye(4))


@dataclass
class MadeUpScan:
    """Points of which only the motion is told by which they are deskewed."""

    time_s: np.ndarray | None = None
    deskewed_by: list[np.ndarray] = field(default_factory=list)
    is_deskewed: bool = False

    def deskewed(self, twist):
        if twist is None:
            return self
        self.deskewed_by.append(twist)
        return replace(self, is_deskewed=True)


STILL, DENSE = MadeUpScan(), MadeUpScan()
MOTION = np.array([1.0, 0, 0, 0, 0, 0.5])
PREPARED = SimpleNamespace(spots=1, sparse=STILL, dense=DENSE, scans=(SCAN,))


def at(x: float) -> np.ndarray:
    return make_transform(np.eye(3), [x, 0, 0])


def standing_at(x_m: list[float]) -> Candidates:
    poses = np.array([at(x) for x in x_m]).reshape(-1, 4, 4)
    return Candidates(np.arange(len(x_m)), poses, np.full(len(x_m), 0.5))


def number_of(T: np.ndarray) -> int:
    return round(T[0, 3] / APART_M)


@dataclass
class MadeUpMap:
    """Map with a given alignment score and free-space violation at each candidate; it notes what is asked."""

    scores: list[float]
    violations: list[float]
    better_beside: dict[int, float] = field(default_factory=dict)  # score of the minimum at larger x
    coarse: dict[int, float] = field(default_factory=dict)  # scores on the coarse grid, if not 0.9
    checked: list[int] = field(default_factory=list)
    registered: list[float] = field(default_factory=list)  # x of the starts
    refined: list[float] = field(default_factory=list)  # x of the starts

    def align_coarse(self, scan, starts):
        self.registered += starts[:, 0, 3].tolist()
        return starts, np.array([self.coarse.get(number_of(T), 0.9) for T in starts])

    def align(self, scan, starts):
        scores = np.array([self._score(T) for T in starts])
        count = len(starts)
        information = np.tile(np.eye(6), (count, 1, 1))
        return Registrations(starts, np.full(count, 0.9), scores, information, np.ones(count, np.bool_))

    def align_smoothly(self, scan, starts):
        return self.align(scan, starts)

    ranking = RANKING

    def align_fine(self, scan, starts, *, twist=None):
        self.refined += starts[:, 0, 3].tolist()
        return self.align(scan, starts)

    def faced_information(self, scan, registration):
        return registration.information

    def agreements(self, scan, T_level_sensor):
        assert T_level_sensor.shape[1:] == (4, 4)
        share = 0.1 if scan is PREPARED.dense else 0.2
        return [Agreement(share, share + number_of(T) / 100) for T in T_level_sensor]

    def seen_through(self, surface, view, T):
        self.checked.append(number_of(T))
        return FreeSpaceShares(self.violations[number_of(T)], 0.0)

    def _score(self, T):
        number = number_of(T)
        beside = T[0, 3] - APART_M * number > RANKING.neighbour_m / 2
        return self.better_beside.get(number, self.scores[number]) if beside else self.scores[number]


def searching(made_up: MadeUpMap, prior=None, calibration=None, points: MadeUpScan | None = None):
    """A search of the map, with points that move if there are any."""
    index = MapIndex(EngineConfig(), calibration or Calibration(), None, made_up, made_up)
    moving = SimpleNamespace(spots=1, sparse=points, dense=points, scans=(SCAN,))
    return HypothesisSearch(index, PREPARED if points is None else moving, prior, "yard")


def search(made_up: MadeUpMap, prior=None, calibration=None):
    candidates = standing_at([APART_M * number for number in range(len(made_up.scores))])
    return searching(made_up, prior, calibration).run(candidates)


def test_without_candidates_nothing_is_found():
    assert search(MadeUpMap([], [])) == []


def test_candidates_are_ranked_by_alignment_and_free_space():
    found = search(MadeUpMap([0.80, 0.85, 0.82], [0.0, 0.05, 0.0]))
    assert [candidate.template for candidate in found] == [2, 0, 1]
    assert found[2].quality.free_space_violation == 0.05
    assert {candidate.map_id for candidate in found} == {"yard"}


def test_a_hopeless_start_is_aligned_no_further():
    made_up = MadeUpMap([0.8, 0.5, 0.9], [0.0] * 3, coarse={0: 0.9, 1: 0.7, 2: 0.8})
    hypotheses = searching(made_up)
    assert [one.template for one in hypotheses.run(standing_at([0.0, 10.0, 20.0]))] == [2, 0]
    assert not len(hypotheses.untried(standing_at([10.0])))


def test_hopeless_places_are_rivals_if_no_place_explains_the_scan():
    made_up = MadeUpMap([0.8, 0.5, 0.82], [0.0] * 3, coarse={0: 0.9, 1: 0.7, 2: 0.8})
    assert [one.template for one in search(made_up)] == [2, 0, 1]


def test_free_space_is_not_checked_where_no_rival_can_be():
    """Not even without any violation would the others be the best rival, or within reach of the best."""
    made_up = MadeUpMap([0.95, 0.94, 0.3, 0.5], [0.0] * 4)
    search(made_up, calibration=NEVER_SURE)
    assert set(made_up.checked) == {0, 1}
    unsure = MadeUpMap([0.95, 0.94, 0.3, 0.5], [0.0, 0.9, 0.0, 0.0])
    search(unsure, calibration=NEVER_SURE)
    assert set(unsure.checked) == {0, 1, 3}  # the fourth is a better rival than the second, the third is not


def test_the_check_ends_where_the_answer_is_clear():
    made_up = MadeUpMap([0.95, 0.4, 0.3, 0.2], [0.0, 0.3, 0.3, 0.3])
    clear = Calibration(bias=-9, alignment_score=3, free_space=2, margin=15)
    assert search(made_up, calibration=clear)[0].template == 0
    assert set(made_up.checked) == {0, 1}
    search(made_up, calibration=NEVER_SURE)
    assert set(made_up.checked) == {0, 1, 2, 3}


def test_a_place_that_aligns_worse_but_contradicts_nothing_is_found():
    """However clear the look-alike seems before the others are checked."""
    made_up = MadeUpMap([0.85, 0.5, 0.45, 0.72], [0.01, 0.2, 0.2, 0.0])
    assert search(made_up)[0].template == 3


def test_only_the_best_and_close_rivals_are_refined():
    made_up = MadeUpMap([0.9, 0.88, 0.2], [0.0] * 3)
    search(made_up)
    assert made_up.refined == [0.0, APART_M]
    crowded = MadeUpMap([0.9, 0.89, 0.88, 0.87, 0.86, 0.85], [0.0] * 6)
    assert len(search(crowded)) == 6
    assert len(crowded.refined) == RANKING.max_refined


def test_a_hopeless_best_is_not_refined():
    measured = Calibration(cases=100)
    hopeless, hopeful = MadeUpMap([0.2, 0.1], [0.2, 0.2]), MadeUpMap([0.95, 0.3], [0.0, 0.2])
    assert len(search(hopeless, calibration=measured)) == 2
    assert not hopeless.refined
    search(hopeful, calibration=measured)
    assert hopeful.refined == [0.0]


def test_a_clearly_better_minimum_beside_a_candidate_is_taken():
    (found,) = search(MadeUpMap([0.80], [0.0], better_beside={0: 0.85}))
    assert found.registration.T_level_sensor[0, 3] == RANKING.neighbour_m
    (found,) = search(MadeUpMap([0.80], [0.0], better_beside={0: 0.81}))
    assert found.registration.T_level_sensor[0, 3] == 0


class WallsAlone(MadeUpMap):
    """Map in which a scan slides down by some metres, where it fits a little worse."""

    slides_m, worse = 0.6, 0.05

    def align_coarse(self, scan, starts):
        slid = starts - self.slides_m * np.eye(4)[2][:, None] * np.eye(4)[3]
        return slid, np.ones(len(starts))

    def _score(self, T):
        return super()._score(T) - self.worse * (T[2, 3] < -0.2)


def test_a_scan_that_slid_down_its_walls_stands_on_the_floor_again():
    (found,) = search(WallsAlone([0.95], [0.0]))
    assert found.registration.T_level_sensor[2, 3] == 0
    assert found.quality.alignment_score == 0.95


def test_a_scan_that_fits_below_the_floor_as_well_stays_there():
    sloping = WallsAlone([0.95], [0.0])
    sloping.worse = 0.0
    (found,) = search(sloping)
    assert found.registration.T_level_sensor[2, 3] == -0.6


def test_a_prior_leaves_out_poses_elsewhere():
    found = search(MadeUpMap([0.9, 0.8], [0.0, 0.0]), prior=Prior(np.array([APART_M, 0, 0]), 2.0))
    assert [candidate.template for candidate in found] == [1]
    assert search(MadeUpMap([0.9, 0.8], [0.0, 0.0]), prior=Prior(np.array([500.0, 0, 0]), 2.0)) == []


def test_agreement_is_measured_at_the_last_alignment():
    found = search(MadeUpMap([0.9, 0.3], [0.0, 0.0]), calibration=NEVER_SURE)
    assert [one.template for one in found] == [0, 1]
    assert [one.quality.beside_surface for one in found] == [0.1, 0.2]  # the second was not refined
    np.testing.assert_allclose([one.quality.same_plane for one in found], [0.1, 0.21])


def test_equal_poses_are_kept_once():
    made_up = MadeUpMap([0.9], [0.0])
    assert [one.template for one in searching(made_up).run(standing_at([0.0, 0.1, 0.2]))] == [0]


def test_a_later_run_registers_only_new_candidates_and_forgets_none():
    made_up = MadeUpMap([0.86, 0.9, 0.88], [0.0] * 3)
    found = searching(made_up)
    assert [one.template for one in found.run(standing_at([0.0, APART_M]))] == [1, 0]
    assert [one.template for one in found.run(standing_at([APART_M + 0.1, 2 * APART_M, 0.2]))] == [1, 1, 0]
    assert made_up.registered == [0.0, APART_M, 2 * APART_M]
    assert len(found.run(standing_at([]))) == 3


def test_a_start_of_another_heading_is_new():
    made_up = MadeUpMap([0.9], [0.0])
    found, candidates = searching(made_up), standing_at([0.0])
    found.run(candidates)
    turned = make_transform(rotation_z(np.radians(10)), [0, 0, 0])
    found.run(Candidates(candidates.template, turned[None], candidates.score))
    assert len(made_up.registered) == 2


def test_a_later_run_does_not_check_the_same_poses_again():
    made_up = MadeUpMap([0.9, 0.88, 0.6], [0.0, 0.1, 0.1])
    search_twice = searching(made_up, calibration=NEVER_SURE)
    search_twice.run(standing_at([0.0, APART_M]))
    first = list(made_up.checked)
    search_twice.run(standing_at([2 * APART_M]))
    assert made_up.checked[len(first) :] == [2]


def test_the_motion_is_solved_at_every_place_that_is_compared():
    """Sparse points at all of them, dense ones at those that are refined. Free space is that of both."""
    views = []

    class Moving(MadeUpMap):
        def align_fine(self, scan, starts, *, twist=None):
            found = super().align_fine(scan, starts)
            return replace(found, twist=np.tile(MOTION, (len(starts), 1)))

        def seen_through(self, surface, view, T):
            views.append(view)
            return super().seen_through(surface, view, T)

    timed = MadeUpScan(np.zeros(3))
    made_up = Moving([0.9, 0.85, 0.7], [0.0] * 3)
    search = searching(made_up, points=timed)
    found = search.run(standing_at([0.0, APART_M, 2 * APART_M]))
    assert made_up.refined[:3] == [0.0, APART_M, 2 * APART_M]
    assert made_up.refined[3:5] == [0.0, APART_M]
    assert all(candidate.registration.twist is not None for candidate in found)
    assert np.array_equal(timed.deskewed_by, np.tile(MOTION, (len(timed.deskewed_by), 1)))
    assert len(timed.deskewed_by) >= len(found)
    assert len(views) >= 3
    assert all(view is not None for view in views)
    sparse_again = [*made_up.refined]
    search.run(standing_at([]))
    assert made_up.refined == [*sparse_again, *sparse_again[3:]]  # only the places that are refined again


def test_a_skewed_scan_is_not_moved_to_a_minimum_of_its_skew():
    """Beside each place stands a better minimum for the scan as it was taken."""

    class Moving(MadeUpMap):
        def align(self, scan, starts):
            self.is_deskewed = scan.is_deskewed
            return super().align(scan, starts)

        def align_fine(self, scan, starts, *, twist=None):
            self.started_with.append(twist)
            found = super().align_fine(replace(scan, is_deskewed=True), starts)
            return replace(found, twist=np.tile(MOTION, (len(starts), 1)))

        def _score(self, T):
            return self.scores[number_of(T)] if self.is_deskewed else super()._score(T)

    made_up = Moving([0.9, 0.85], [0.0] * 2, better_beside={0: 0.97, 1: 0.96})
    made_up.started_with = []
    found = searching(made_up, points=MadeUpScan(np.zeros(3))).run(standing_at([0.0, APART_M]))
    assert [one.registration.T_level_sensor[0, 3] for one in found] == [0.0, APART_M]
    assert [one.registration.alignment_score for one in found] == [0.9, 0.85]
    assert np.array_equal(made_up.started_with[-1], np.tile(MOTION, (2, 1)))  # each with its own motion


def test_candidates_with_a_motion_are_compared_with_poses_in_motion():
    """A skewed scan lies askew where it is aligned rigidly: known aliases stand where the sensor would be."""
    moved_m = 0.5

    class Moving(MadeUpMap):
        def align_fine(self, scan, starts, *, twist=None):
            found = super().align_fine(scan, starts)
            there = starts.copy()
            there[:, 0, 3] += moved_m
            return replace(found, T_level_sensor=there, twist=np.tile(MOTION, (len(starts), 1)))

    made_up = Moving([0.9, 0.85], [0.0] * 2)
    timed = MadeUpScan(np.zeros(3))
    search = searching(made_up, calibration=NEVER_SURE, points=timed)
    search.run(standing_at([0.0]))
    assert len(search.untried(standing_at([0.0, moved_m]))) == 1
    untried = search.untried(standing_at([0.0, moved_m]), MOTION)
    assert untried.T_level_sensor[:, 0, 3].tolist() == [0.0]
    before = len(timed.deskewed_by)
    search.run(standing_at([APART_M]), MOTION)
    assert np.array_equal(timed.deskewed_by[before], MOTION)  # the new one is aligned deskewed


CLEAR = Calibration(bias=-9, alignment_score=3, free_space=2, margin=15, alias_margin=0.2)
RACING = np.array([12.0, 0, 0, 0, 0, 0])


def test_places_of_unlikely_motion_do_not_end_the_check():
    """They align better, but count for less: the true place, where things have moved, is the best rival."""

    class Moving(MadeUpMap):
        def align_fine(self, scan, starts, *, twist=None):
            twists = [RACING if number_of(T) in (1, 2) else np.zeros(6) for T in starts]
            return replace(super().align_fine(scan, starts), twist=np.array(twists))

    made_up = Moving([0.93, 0.91, 0.9, 0.85], [0.0] * 4)
    found = searching(made_up, calibration=CLEAR, points=MadeUpScan(np.zeros(3))).run(
        standing_at([0.0, 10.0, 20.0, 30.0])
    )
    assert [one.template for one in found] == [0, 3]


def test_a_known_alias_is_checked_before_a_clear_answer():
    made_up = MadeUpMap([0.95, 0.9, 0.87, 0.7], [0.0, 0.3, 0.0, 0.0])
    hypotheses = searching(made_up, calibration=CLEAR)
    found = hypotheses.run(standing_at([0.0, 10.0, 20.0, 30.0]))
    assert [one.template for one in found] == [0, 1]
    near, far = (standing_at([x]).T_level_sensor for x in (20.3, 30.0))
    assert hypotheses.leaves_out(near)
    assert not hypotheses.leaves_out(far), "it is too weak to tie"
    assert not hypotheses.leaves_out(np.empty((0, 4, 4)))
    again = hypotheses.run(standing_at([]), aliases=np.concatenate([near, far]))
    assert [one.template for one in again] == [0, 2, 1]
    assert not hypotheses.leaves_out(far)

"""Search beside a place, along a facade whose pilasters repeat."""

from types import SimpleNamespace

import numpy as np
import pytest

from firstfix.answer.prior import Prior
from firstfix.bit_exact.sample import rows_by_chance
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig, NearbyConfig, RegistrationConfig
from firstfix.engine.index import FreeSpaceShares, MapIndex
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.registration.align import Agreement, MapSurface, Registration
from firstfix.engine.registration.surface import Surface
from firstfix.transform import make_transform, pose_error
from tests.reference import hypotheses as hypotheses_module
from tests.reference.hypotheses import HypothesisSearch
from tests.reference.local_search import best_near, offsets_along, offsets_around

NEARBY = NearbyConfig()
STEP_M = 0.9  # from pilaster to pilaster
TRUE = make_transform(np.eye(3), [0.0, -4.0, 1.5])
CONFIG = RegistrationConfig(map_voxel_m=0.1, coarse_voxel_m=0.6)


def plane(corner, along, up, step_m=0.06) -> np.ndarray:
    """Points of a rectangle, which is spanned by two vectors."""
    along, up = np.array(along, float), np.array(up, float)
    a = np.arange(0, np.linalg.norm(along), step_m)[:, None, None] * along / np.linalg.norm(along)
    b = np.arange(0, np.linalg.norm(up), step_m)[:, None] * up / np.linalg.norm(up)
    return (np.array(corner, float) + a + b).reshape(-1, 3)


def facade() -> np.ndarray:
    """A wall with pilasters every 0.9 m, a porch that they lack elsewhere, and a floor before it."""
    parts = [plane((-12, 0, 0), (24, 0, 0), (0, 0, 3)), plane((-12, -8, 0), (24, 0, 0), (0, 8, 0))]
    parts += [plane((x, -2, 0), (0, 2, 0), (0, 0, 3)) for x in (2.1, 4.6)]
    for number in range(-13, 14):
        for side in (0.0, 0.4):
            parts.append(plane((number * STEP_M + side, -0.3, 0), (0, 0.3, 0), (0, 0, 1.2)))
        parts.append(plane((number * STEP_M, -0.3, 0), (0.4, 0, 0), (0, 0, 1.2)))
    return np.concatenate(parts)


@pytest.fixture(scope="module")
def street() -> MapSurface:
    points = facade()
    return MapSurface.of(Surface.around(points, np.array([0, -4, 1.5]) - points), CONFIG)


@pytest.fixture(scope="module")
def query() -> SimpleNamespace:
    seen = facade() - TRUE[:3, 3]
    seen = seen[np.abs(seen[:, 0]) < 7]
    noise_m = np.random.default_rng(3).normal(0, 0.01, seen.shape)
    scan = Surface.around((seen + noise_m)[rows_by_chance(len(seen), 4000)])
    return SimpleNamespace(dense=scan, sparse=scan.at_most(400, 0.25))


def aligned_from(street: MapSurface, query, offset_m) -> Registration:
    start = TRUE @ make_transform(np.eye(3), [*offset_m, 0.0])
    return street.align_fine(query.dense, start[None])[0]


@pytest.mark.parametrize("steps", [-2, -1, 1, 3])
def test_a_place_a_few_pilasters_off_is_moved_to_the_truth(street, query, steps):
    wrong = aligned_from(street, query, [steps * STEP_M, 0.05])
    assert pose_error(TRUE, wrong.T_level_sensor)[0] == pytest.approx(abs(steps) * STEP_M, abs=0.05)
    found = best_near(street, query, wrong, offsets_around(NEARBY), NEARBY)
    assert found is not None
    assert pose_error(TRUE, found.T_level_sensor)[0] < 0.02
    along = best_near(street, query, wrong, offsets_along(NEARBY, wrong), NEARBY)
    assert along is not None
    assert pose_error(TRUE, along.T_level_sensor)[0] < 0.02


def test_at_the_truth_nothing_is_better(street, query):
    right = aligned_from(street, query, [0.0, 0.0])
    assert best_near(street, query, right, offsets_around(NEARBY), NEARBY) is None
    assert best_near(street, query, right, offsets_along(NEARBY, right), NEARBY) is None


def test_beyond_its_reach_nothing_is_found(street, query):
    wrong = aligned_from(street, query, [2 * STEP_M, 0.0])
    near = replace_reach(1.0)
    assert best_near(street, query, wrong, offsets_around(near), near) is None


def replace_reach(reach_m: float) -> NearbyConfig:
    return NEARBY.model_copy(update={"reach_m": reach_m})


def test_starts_stand_all_around_within_the_reach():
    offsets_m = offsets_around(NEARBY)
    far_m = np.linalg.norm(offsets_m, axis=1)
    assert far_m.min() == pytest.approx(NEARBY.step_m)
    assert far_m.max() <= NEARBY.reach_m + 1e-9
    assert len(np.unique(offsets_m.round(6), axis=0)) == len(offsets_m)
    assert not len(offsets_around(replace_reach(0.0)))


def test_starts_stand_along_the_free_direction_of_a_facade(street, query):
    offsets_m = offsets_along(NEARBY, aligned_from(street, query, [0.0, 0.0]))
    assert len(offsets_m) == 12
    np.testing.assert_allclose(np.abs(offsets_m[:, 0]).max(), NEARBY.reach_m, rtol=0.01)
    assert np.abs(offsets_m[:, 1]).max() < 0.3  # the facade holds it across
    free = Registration(np.eye(4), 0.0, 0.0, np.zeros((6, 6)))
    assert np.isfinite(offsets_along(NEARBY, free)).all()


class MapWithoutHoles:
    """Map in which every pose agrees alike."""

    def agreements(self, scan, T_level_sensor):
        return [Agreement(0.0, 0.0) for _ in T_level_sensor]

    def seen_through(self, surface, view, T):
        return FreeSpaceShares(0.0, 0.0)


def search_with(monkeypatch, found: Registration | None, prior: Prior | None = None):
    """A search whose local search finds the same thing everywhere, and the number of times that it ran."""
    ran = []
    made_up, still = MapWithoutHoles(), SimpleNamespace(time_s=None)
    scan = SimpleNamespace(view_deskewed=lambda twist: twist, T_last_scan=np.eye(4))
    index = MapIndex(EngineConfig(), Calibration(), None, made_up, made_up)
    monkeypatch.setattr(hypotheses_module, "best_near", lambda *given: ran.append(given) or found)
    prepared = SimpleNamespace(sparse=still, dense=still, scans=(scan,))
    return index, HypothesisSearch(index, prepared, prior, "yard"), ran


def at(index: MapIndex, x_m: float, score: float) -> RegisteredCandidate:
    T = make_transform(np.eye(3), [x_m, 0, 0])
    return RegisteredCandidate(index, "yard", 7, Registration(T, 0.9, score, np.eye(6)))


def test_the_best_place_moves_and_others_stay(monkeypatch):
    beside = Registration(make_transform(np.eye(3), [1.5, 0, 0]), 0.95, 0.9, np.eye(6))
    index, search, ran = search_with(monkeypatch, beside)
    found = [at(index, 0.0, 0.8), at(index, 40.0, 0.7)]
    moved = search.search_near(found, np.ones((3, 2)))
    assert [one.T_map_sensor[0, 3] for one in moved] == [1.5, 40.0]
    assert moved[0].template == 7
    again = search.search_near(found, np.ones((3, 2)))
    assert [one.T_map_sensor[0, 3] for one in again] == [1.5, 40.0]
    assert len(ran) == 1  # what a pose has beside it is found once


def test_without_a_better_place_all_stay(monkeypatch):
    index, search, _ = search_with(monkeypatch, None)
    found = [at(index, 0.0, 0.8), at(index, 40.0, 0.7)]
    assert search.search_near(found, np.ones((3, 2))) == found


def test_a_prior_forbids_to_move_out_of_it(monkeypatch):
    beside = Registration(make_transform(np.eye(3), [2.5, 0, 0]), 0.95, 0.9, np.eye(6))
    index, search, _ = search_with(monkeypatch, beside, Prior((0.0, 0.0, 0.0), 1.0))
    found = [at(index, 0.0, 0.8)]
    assert [one.T_map_sensor[0, 3] for one in search.search_near(found, np.ones((3, 2)))] == [0.0]

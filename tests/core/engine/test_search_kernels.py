"""The compiled search, against the plain one: every pose, and every number of it, run after run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from firstfix import native
from firstfix.answer.prior import Prior
from firstfix.engine.calibration import Calibration
from firstfix.engine.candidates import Candidates, prior_numbers
from firstfix.engine.config import EngineConfig, PreprocessConfig
from firstfix.engine.index import MapIndex, MapView
from firstfix.engine.preprocess import PreparedQuery, preprocess
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.engine.retrieval.alias_table import AliasTable
from firstfix.engine.retrieval.cascade import Cascade, Clusters, Templates
from firstfix.engine.retrieval.key_search.exhaustive import Exhaustive
from firstfix.engine.retrieval.template_tiles import TemplateTiles
from firstfix.engine.verification.seen_free import SeenFree
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import Matrix, make_transform, rotation_z
from tests.core.engine.test_local_search import TRUE, facade
from tests.reference import hypotheses as reference
from tests.reference.hypothesis_steps import HypothesisSteps
from tests.reference.recorded_places import recorded_place
from tests.reference.template_places import known_aliases

CONFIG = EngineConfig()
UNSURE = Calibration(bias=-100.0, cases=1, search_until=0.999)
SURE = Calibration(bias=0.0, cases=1, among_tied=(0.0, 1.0, 1.0, 1.0, 1.0, 1.0))
CALIBRATIONS = {"prior": Calibration(), "unsure": UNSURE, "sure": SURE}
SEEDS = (1, 2)
MOTION = np.array([1.2, 0.1, 0.0, 0.0, 0.0, 0.4])


@pytest.fixture(scope="module")
def index() -> MapIndex:
    points = facade()
    surface = MapSurface.of(Surface.around(points, np.array([0, -4, 1.5]) - points), CONFIG.registration)
    rng = np.random.default_rng(4)
    brick = np.unique(rng.integers(-8, 8, (60, 3)).astype(np.int32), axis=0)
    bits = rng.integers(-(2**31), 2**31, (len(brick), 8, 2)).astype(np.int32)
    return MapIndex(
        CONFIG,
        Calibration(),
        None,
        surface,
        MapView.of(points, 25.0),
        seen_free=SeenFree.of_bricks(brick, bits, 0.2),
    )


@pytest.fixture(scope="module")
def alike(index: MapIndex) -> MapIndex:
    """The map with templates along the facade on two floors, whose aliases are some pilasters further."""
    along = np.arange(-10, 11, dtype=np.float32)
    position_m = np.array([[x, -4, 1.5 + up] for up in (0, 3) for x in along], np.float32)
    count, rng = len(position_m), np.random.default_rng(7)
    templates = Templates(position_m, np.full(count, 1.5, np.float32), {})
    cascade = Cascade(
        CONFIG.descriptor.make(),
        templates,
        TemplateTiles.of(position_m),
        Clusters.alone(count),
        Exhaustive.build(np.zeros((count, 2), np.float32), CONFIG.search),
    )
    table = AliasTable.none(count, 6)
    for template in range(count):
        others = rng.choice(len(along), 5, replace=False)
        table.put(
            template, others, rng.choice([0.0, 0.0, np.pi, 0.05], 5), np.sort(rng.uniform(0.5, 1, 5))[::-1]
        )
    return replace(index, cascade=cascade, aliases=table)


def seen_from(T: Matrix, seed: int, *, in_motion: bool = False) -> Scan:
    """A scan of the facade, with noise."""
    rng = np.random.default_rng(seed)
    seen = (facade() - T[:3, 3]) @ T[:3, :3]
    seen = seen[np.abs(seen[:, 0]) < 7]
    points = (seen + rng.normal(0, 0.01, seen.shape)).astype(np.float32)
    if not in_motion:
        return Scan(points)
    time_s = rng.uniform(-0.1, 0.0, len(points)).astype(np.float32)
    return Scan(native.deskew(points, -time_s, MOTION), time_s=time_s)


def query_of(*scans: Scan, T_last_scan: Sequence[Matrix] = ()) -> PreparedQuery:
    sequence = ScanSequence(scans, (*T_last_scan, np.eye(4)))
    query = preprocess(sequence, np.array([0.0, 0.0, -1.0]), PreprocessConfig(voxel_m=0.05))
    assert query is not None
    return query


def starts_around(T: Matrix, seed: int, count: int = 12, reach_m: float = 4.0) -> Candidates:
    rng = np.random.default_rng(seed)
    off = [
        make_transform(
            rotation_z(rng.uniform(-0.1, 0.1)), [*rng.uniform(-reach_m, reach_m, 2), rng.uniform(0, 0.5)]
        )
        for _ in range(count)
    ]
    score = rng.uniform(0, 1, count)
    return Candidates(np.arange(count), np.array([T @ one for one in off]), score)


def numbers_of(one: RegisteredCandidate) -> list[float]:
    placed = one.registration
    twist = [] if placed.twist is None else placed.twist.tolist()
    seen_free = -1.0 if one.free_space.seen_free is None else one.free_space.seen_free
    return [
        *placed.T_level_sensor.ravel().tolist(),
        *placed.information.ravel().tolist(),
        placed.inlier_ratio,
        placed.alignment_score,
        *twist,
        one.free_space.free_space_violation,
        one.free_space.removed_surface,
        seen_free,
        one.agreement.beside_surface,
        one.agreement.same_plane,
        one.start_z_m,
        one.support,
    ]


def are_same(found: list[RegisteredCandidate], wanted: list[RegisteredCandidate], off: float = 0.0) -> None:
    assert [one.template for one in found] == [one.template for one in wanted]
    for mine, its in zip(found, wanted, strict=True):
        assert mine.registration.rests == its.registration.rests
        assert (mine.spots, mine.map_id) == (its.spots, its.map_id)
        np.testing.assert_allclose(numbers_of(mine), numbers_of(its), rtol=off, atol=off)


def search_both(
    index: MapIndex, query: PreparedQuery, seed: int, prior: Prior | None = None, off: float = 0.0
) -> list[RegisteredCandidate]:
    """Runs both searches, wider and wider, lets aliases compete, and compares all they say."""
    compiled = HypothesisSteps(index, query, prior, "yard")
    plain = reference.HypothesisSearch(index, query, prior, "yard")
    found: list[RegisteredCandidate] = []
    for step, count in enumerate((12, 20, 8)):
        starts = starts_around(TRUE, 10 * seed + step, count)
        found, wanted = compiled.run(starts, nearby=step != 1), plain.run(starts, nearby=step != 1)
        are_same(found, wanted, off)
        assert compiled.is_settled == plain.is_settled
        assert compiled.explains_scan == plain.explains_scan
    if not found:
        return found
    best = found[0].registration
    near = starts_around(best.T_level_sensor, seed, 10)
    mine = compiled.not_far_behind(near, best.T_level_sensor, best.twist)
    its = plain.not_far_behind(near, best.T_level_sensor, best.twist)
    np.testing.assert_array_equal(mine.template, its.template)
    aliases = np.concatenate([near.T_level_sensor, [one.registration.T_level_sensor for one in found]])
    are_same(compiled.run(near, best.twist, aliases), plain.run(near, best.twist, aliases), off)
    for needed in (None, 0.5, 1.0):
        assert compiled.is_accepted(needed) == plain.is_accepted(needed)
        compiled.try_aliases(needed, nearby=True)
        plain.try_aliases(needed, nearby=True)
        mine, its = compiled.with_look_alikes_marked(), plain.with_look_alikes_marked()
        are_same(mine, its, off)
        assert [one.is_alike for one in mine] == [one.is_alike for one in its]
    if prior is not None:
        mine, its = compiled.aliases_outside(), plain.aliases_outside()
        np.testing.assert_array_equal(mine.template, its.template)
        anywhere, everywhere = HypothesisSteps(index, query), reference.HypothesisSearch(index, query)
        anywhere.run(starts_around(TRUE, seed, 30)), everywhere.run(starts_around(TRUE, seed, 30))
        assert compiled.lead_outside(anywhere) == pytest.approx(plain.lead_outside(everywhere), abs=off)
    return found


@pytest.mark.parametrize("name", CALIBRATIONS)
@pytest.mark.parametrize("seed", SEEDS)
def test_every_bit_is_that_of_the_plain_search(index: MapIndex, name: str, seed: int):
    judged = replace(index, calibration=CALIBRATIONS[name])
    assert search_both(judged, query_of(seen_from(TRUE, seed)), seed)


@pytest.mark.parametrize("name", CALIBRATIONS)
@pytest.mark.parametrize("seed", SEEDS)
def test_known_aliases_compete_as_in_the_plain_search(alike: MapIndex, name: str, seed: int):
    judged = replace(alike, calibration=CALIBRATIONS[name])
    assert search_both(judged, query_of(seen_from(TRUE, seed)), seed)


def test_aliases_outside_a_prior_are_compared_as_in_the_plain_search(alike: MapIndex):
    search_both(alike, query_of(seen_from(TRUE, 3)), 3, Prior(TRUE[:3, 3], 2.0, 0.0, 30.0))


def test_aliases_of_a_scan_in_motion_compete_as_in_the_plain_search(alike: MapIndex):
    search_both(alike, query_of(seen_from(TRUE, 1, in_motion=True)), 1, off=1e-6)


@pytest.mark.parametrize("prior", [None, Prior(TRUE[:3, 3], 3.0, 10.0, 30.0)], ids=["free", "prior"])
def test_known_aliases_are_those_of_the_table_and_the_floors(alike: MapIndex, prior: Prior | None):
    numbers = None if prior is None else prior_numbers(prior, alike)
    counts = set()
    for x in np.random.default_rng(5).uniform(-20, 20, 60):
        T = make_transform(rotation_z(0.3 * x), [x, -3.5, 1.6])
        mine = Candidates(*alike.searched.known_aliases(T, numbers))
        its = known_aliases(alike, T, prior)
        np.testing.assert_array_equal(mine.template, its.template)
        np.testing.assert_array_equal(mine.score, its.score)
        np.testing.assert_allclose(mine.T_level_sensor, its.T_level_sensor, rtol=0, atol=1e-12)
        counts.add(len(mine))
    assert len(counts) > 3, "some poses have many, some few, and those far away none"


@pytest.mark.parametrize("seed", SEEDS)
def test_a_map_that_was_never_seen_free(index: MapIndex, seed: int):
    assert search_both(replace(index, seen_free=None), query_of(seen_from(TRUE, seed)), seed)


@pytest.mark.parametrize("radius_m", [0.01, 1.0, 3.0])
def test_a_prior_leaves_out_the_same_poses(index: MapIndex, radius_m: float):
    prior = Prior(TRUE[:3, 3] + [0.5, 0, 0], radius_m, 5.0, 20.0)
    found = search_both(index, query_of(seen_from(TRUE, 3)), 3, prior)
    assert all(prior.allows(one.T_map_sensor) for one in found)


def test_scans_of_several_spots_add_up(index: MapIndex):
    moved = make_transform(rotation_z(0.2), [1.5, -0.4, 0.0])
    query = query_of(seen_from(TRUE @ moved, 5), seen_from(TRUE, 6), T_last_scan=[moved])
    assert search_both(index, query, 5, off=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_motion_is_solved_at_the_same_places(index: MapIndex, seed: int):
    found = search_both(index, query_of(seen_from(TRUE, seed, in_motion=True)), seed, off=1e-6)
    assert all(one.registration.twist is not None for one in found)


@pytest.mark.parametrize("name", ["hall", "street"])
def test_recorded_scans_have_the_same_poses(name: str):
    place = recorded_place(name)
    index = MapIndex(CONFIG, Calibration(), None, place.surface, place.view)
    for seed, (query, T_map_sensor) in enumerate(place.scans):
        compiled, plain = HypothesisSteps(index, query), reference.HypothesisSearch(index, query)
        for reach_m in (0.7, 5.0):
            starts = starts_around(T_map_sensor, seed, 20, reach_m)
            are_same(compiled.run(starts, nearby=True), plain.run(starts, nearby=True))


def test_without_candidates_nothing_is_found(index: MapIndex):
    search = HypothesisSteps(index, query_of(seen_from(TRUE, 1)), Prior(np.zeros(3), 1.0))
    nothing = Candidates(np.empty(0, np.int64), np.empty((0, 4, 4)), np.empty(0))
    assert search.run(nothing, nearby=True) == []
    assert not search.is_settled
    assert not search.explains_scan
    assert not search.is_accepted(0.0)
    assert search.try_aliases(None, nearby=True) == []
    assert search.with_look_alikes_marked() == []
    assert not len(search.aliases_outside())
    assert search.lead_outside(search) == 0


def test_arrays_that_do_not_fit_are_refused(index: MapIndex):
    query = query_of(seen_from(TRUE, 1))
    search = HypothesisSteps(index, query)
    starts = starts_around(TRUE, 1)
    with pytest.raises(ValueError, match="differ in length"):
        search.run(replace(starts, template=starts.template[1:]))
    with pytest.raises(ValueError, match="too fast"):
        search.run(starts, np.array([1e9, 0, 0, 0, 0, 0]))
    with pytest.raises(ValueError, match="prior is not finite"):
        HypothesisSteps(index, query, Prior(np.array([np.nan, 0, 0]), 1.0))
    with pytest.raises(ValueError, match="no scan"):
        preprocess(ScanSequence((), ()), None, PreprocessConfig())
    config = CONFIG.model_copy(
        update={"ranking": CONFIG.ranking.model_copy(update={"fine_angle": float("nan")})}
    )
    with pytest.raises(ValueError, match="not finite"):
        HypothesisSteps(replace(index, config=config), query)

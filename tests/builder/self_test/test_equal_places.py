"""Equal places: which are, and how unequally a scan may fit them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.builds.config import ActivateConfig, BuildConfig, SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.ranking import RANKING
from firstfix.sensor import SensorModel
from firstfix.transform import Matrix, make_transform, rotation_z
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.self_test import asks, run
from firstfix_builder.self_test import equal_places as equal_places_module
from firstfix_builder.self_test.equal_places import EqualPlaces, equal_places, share_seen_alike, tie_width
from firstfix_builder.self_test.real_scans import RealScans
from firstfix_builder.simulation.boxes import Boxes
from firstfix_builder.simulation.simulate import Simulator
from tests.small_world import COARSE_CONFIG, SmallWorld

STOREY_M = 3.5
SENSOR = SensorModel("rings", tuple(np.linspace(-20, 20, 9).tolist()), 2.0, 0.1, 60.0, 0.8)
LOWER = make_transform(rotation_z(0.5), [1.0, 0.8, 0.8])
UPPER = make_transform(rotation_z(0.5), [1.0, 0.8, 0.8 + STOREY_M])


def two_storeys(*in_the_upper: tuple[list[float], list[float]]) -> Simulator:
    """Two rooms of 12 by 8 m with a shelf, one above the other, and more things in the upper one."""
    boxes = [
        ([x, y, z + level], half)
        for level in (0.0, STOREY_M)
        for (x, y, z), half in (([0.0, 0.0, 1.5], [6.0, 4.0, 1.5]), ([3.0, 2.5, 1.0], [0.3, 1.4, 1.0]))
    ]
    centre, half = zip(*boxes, *in_the_upper, strict=True)
    return Simulator(*Boxes(np.array(centre), np.array(half), np.zeros(len(centre))).mesh())


def answer(*places: tuple[Matrix, float]) -> Localization:
    """Hypotheses by pose and alignment score, in the map frame."""
    found = [Hypothesis(T, AlignmentQuality(0.95, score, 0.0), 0.1, 0, "") for T, score in places]
    return Localization(Verdict.REJECTED, (Reason.LOW_PROBABILITY,), hypotheses=tuple(found))


def support(score: float) -> float:
    return RANKING.support(AlignmentQuality(0.95, score, 0.0))


def equals_of(found: Localization, world: Simulator) -> EqualPlaces:
    return equal_places(found, world, SENSOR, LOWER, np.eye(4), RANKING)


def test_storeys_of_one_plan_are_seen_alike_until_one_is_furnished():
    assert share_seen_alike(two_storeys(), SENSOR, LOWER, UPPER) > 0.99
    furnished = two_storeys(([-2.0, 0.0, 1.0 + STOREY_M], [0.5, 1.5, 1.0]))
    assert share_seen_alike(furnished, SENSOR, LOWER, UPPER) < 0.95
    aside = make_transform(rotation_z(0.5), [2.0, 0.8, 0.8])
    assert share_seen_alike(two_storeys(), SENSOR, LOWER, aside) < 0.9


@pytest.mark.parametrize("first", ["the true one", "the other"])
def test_the_supports_of_equal_places_tell_how_far_they_differ(first: str):
    scores = (0.95, 0.92) if first == "the true one" else (0.92, 0.95)
    places = sorted(zip((LOWER, UPPER), scores, strict=True), key=lambda place: -place[1])
    found = equals_of(answer(*places), two_storeys())
    assert found.unequal_by == pytest.approx(support(0.95) - support(0.92))
    assert found.numbers == ((1,) if first == "the true one" else (0,))


def test_what_is_no_equal_place_tells_nothing():
    furnished = two_storeys(([-2.0, 0.0, 1.0 + STOREY_M], [0.5, 1.5, 1.0]))
    both = answer((LOWER, 0.95), (UPPER, 0.92))
    assert equals_of(both, furnished) == EqualPlaces(), "the storeys differ"
    far = answer((LOWER, 0.95), (UPPER, 0.3))
    assert equals_of(far, two_storeys()) == EqualPlaces(), "the margin is as large as any"
    missed = answer((UPPER, 0.95))
    assert equals_of(missed, two_storeys()) == EqualPlaces(), "the place was not found"


def test_equal_places_tie_but_for_rare_ones():
    usual = np.linspace(0.0, 0.1, 99).tolist()
    width = tie_width([*usual, 0.24, None, None])
    assert np.mean(np.array(usual) < width) >= 0.95
    assert 0.09 < width < 0.11, "one scan alone does not make it"


def test_of_few_equal_places_nothing_is_learned():
    least = Calibration().min_margin
    assert tie_width([]) == tie_width([None] * 100) == tie_width([0.2] * 5 + [None] * 95) == least
    assert tie_width([0.01] * 100) == least, "what is closer ties anyway"


def test_a_maps_own_width_is_measured_by_its_self_test(
    coarse_version: BuildResult, small_world: SmallWorld, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(asks, "equal_places", lambda *_: EqualPlaces((), 0.12))
    monkeypatch.setattr(equal_places_module, "_MIN_SCANS", 2)
    with ThreadPoolExecutor(1) as executor:
        _, calibration, _, _ = run.run_self_test(
            Localizer(MapIndex.load(coarse_version.directory, Calibration())),
            Simulator(small_world.vertices, small_world.triangles),
            BuildConfig.parse(COARSE_CONFIG).sensor_model,
            SelfTestConfig(queries=2, outside=1),
            ActivateConfig(),
            RealScans(),
            executor,
            lambda done: None,
            lambda: False,
        )
    assert calibration.min_margin == tie_width([0.12] * 2) > 0.12

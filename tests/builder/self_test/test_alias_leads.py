"""The width of a tie of known aliases: what disturbances take from the lead of the true place."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import BuildConfig, SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.engine.ranking import RANKING
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.self_test.alias_leads import alias_tie_width, aliases_among, lead_lost
from firstfix_builder.simulation.perturb import ScanSimulation
from firstfix_builder.simulation.simulate import Simulator
from tests.once_a_run import OnceARun
from tests.storey_world import CONFIG, ROOMS_X, pose, scan_at, storey, storey_version

MIN, MAX = Calibration().min_margin, RANKING.max_margin


def width(lost: list[float | None], least: float = MIN) -> float:
    return alias_tie_width(lost, least, MAX)


def test_nine_in_ten_losses_are_less_than_the_width():
    lost = np.linspace(0.0, 0.2, 60).tolist()
    assert 0.85 < np.mean(np.array(lost) < width([*lost, None, None])) < 0.95


def test_the_width_is_neither_below_that_of_all_places_nor_above_what_margins_count():
    assert width([0.01] * 60) == width([-0.1] * 60) == MIN
    assert width([0.01] * 60, 0.08) == 0.08
    assert width([0.9] * 60) == MAX


def test_of_few_places_with_aliases_nothing_is_learned():
    assert width([]) == width([None] * 60) == width([0.2] * 19 + [None] * 41) == MIN


@pytest.fixture(scope="module")
def version(once_a_run: OnceARun) -> BuildResult:
    return storey_version(once_a_run)


@pytest.mark.slow
def test_what_moved_costs_the_true_room_a_part_of_its_lead(version: BuildResult):
    """Rooms that look alike: nothing is lost where nothing is disturbed."""
    index = MapIndex.load(version.directory)
    world = storey()
    simulator = Simulator(world.vertices, world.triangles)
    calm = SelfTestConfig().perturb.model_copy(
        update={"occluders": 0, "strangers": 0, "unmapped": 0, "vanished": 0}
    )
    sensor = BuildConfig.parse(CONFIG).sensor_model
    at_m = index.cascade.templates.position_m
    localizer = Localizer(index, explains=False)
    lost = {}
    for name, config in (("calm", calm), ("moved", SelfTestConfig().perturb)):
        simulation = ScanSimulation(simulator, sensor, config)
        cases = simulation.cases(at_m, 1.0, 12, np.random.default_rng(2))
        lost[name] = [
            lead_lost(
                localizer,
                simulation,
                case,
                simulation.clean_ranges(case),
                simulation.scan(case),
                LocalizeOptions(),
            )
            for case in cases
        ]
    assert {by for by in lost["calm"] if by is not None} == {0.0}
    assert max(abs(by) for by in lost["moved"] if by is not None) > 0.005


@pytest.mark.slow
def test_the_other_rooms_are_known_as_aliases_of_the_best_hypothesis(version: BuildResult):
    index = MapIndex.load(version.directory)
    localizer, scan = Localizer(index), scan_at(storey(), pose(ROOMS_X[0], 0.3, 40), 4)
    answer = localizer.localize(scan)
    found = aliases_among(index, answer)
    assert 0 not in found
    away_m = [
        abs(answer.hypotheses[n].T_map_sensor[0, 3] - answer.hypotheses[0].T_map_sensor[0, 3]) for n in found
    ]
    assert len(away_m) >= 1
    assert min(away_m) > 5.0

"""When the self-test ends: what it decides is decided, by a rule that looks at fixed points."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import pytest

from firstfix.builds.config import ActivateConfig, BuildConfig, SelfTestConfig
from firstfix.engine.calibration import Calibration
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.self_test import run
from firstfix_builder.self_test.enough import (
    FIRST_LOOK,
    FOUND,
    PLACES,
    ROUNDS,
    THRESHOLD,
    TIES,
    are_steady,
    still_open,
)
from firstfix_builder.self_test.real_scans import RealScans
from firstfix_builder.self_test.results import SelfTest
from firstfix_builder.simulation.simulate import Simulator
from tests.small_world import COARSE_CONFIG, SmallWorld


@dataclass(frozen=True)
class Known:
    """An outcome of which only these two things are asked."""

    found: bool
    localized: bool

    def found_by(self, calibration: Calibration) -> bool:
        return self.found

    def accepted_by(self, calibration: Calibration) -> bool:
        return self.localized


def opened(
    localized: int,
    silent: int,
    lost: int,
    *,
    is_threshold_settled: bool = True,
    are_ties_settled: bool = True,
) -> tuple[str, ...]:
    """The open questions after so many scans: localized, found and not said, and not found."""
    inside = [
        *[Known(True, True)] * localized,
        *[Known(True, False)] * silent,
        *[Known(False, False)] * lost,
    ]
    return still_open(
        inside,
        Calibration(),
        ActivateConfig(),
        is_threshold_settled=is_threshold_settled,
        are_ties_settled=are_ties_settled,
    )


def test_a_good_map_is_decided_by_half_of_the_scans():
    assert opened(60, 0, 0) == opened(55, 5, 0) == ()


@pytest.mark.parametrize(("localized", "lost"), [(8, 0), (48, 12), (54, 6)])
def test_the_share_found_is_open_while_few_scans_or_a_middling_share_could_turn_it(localized: int, lost: int):
    assert FOUND in opened(localized, 0, lost)


def test_no_scan_at_all_decides_nothing():
    assert FOUND in opened(0, 0, 0)


def test_a_map_that_finds_nothing_is_held_back_soon_and_its_places_are_not_looked_for():
    assert opened(4, 0, 56, are_ties_settled=False) == ()
    assert opened(4, 0, 56, are_ties_settled=False, is_threshold_settled=False) == (THRESHOLD,)


def test_a_threshold_that_more_scans_would_change_is_open():
    assert opened(60, 0, 0, is_threshold_settled=False) == (THRESHOLD,)


def test_the_widths_of_ties_are_open_while_rounds_move_them():
    assert opened(60, 0, 0, are_ties_settled=False) == (TIES,)
    assert opened(60, 0, 0) == ()


@pytest.mark.parametrize(
    ("alias_widths", "steady"),
    [
        ((0.05, 0.05, 0.05), True),  # nothing ties wider than usual
        ((0.25, 0.25, 0.25), True),  # as wide as a width can be
        ((0.12, 0.13, 0.115), True),
        ((0.05, 0.13, 0.13), False),  # the first round had too few scans of such places
        ((0.12, 0.13, 0.15), False),
        ((0.2, 0.12, 0.12, 0.13), True),  # what was before does not count
    ],
)
def test_widths_are_steady_when_three_looks_agree(alias_widths: tuple[float, ...], steady: bool):
    assert are_steady([(0.05, wide) for wide in alias_widths]) is steady
    assert are_steady([(wide, 0.25) for wide in alias_widths]) is steady, "of all places as of aliases"


def test_many_scans_that_are_not_localized_are_all_asked_where_they_are():
    assert opened(45, 15, 0) == (PLACES,)


@pytest.fixture(scope="module")
def asked(coarse_version: BuildResult, small_world: SmallWorld):
    """Run the self-test of a small yard, by what is open at each look."""

    def ask(answers: list[tuple[str, ...]], **config: object) -> tuple[SelfTest, Calibration]:
        looks = iter(answers)
        with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(2) as executor:
            patch.setattr(run, "still_open", lambda *_, **__: next(looks))
            found, calibration, _, _ = run.run_self_test(
                Localizer(MapIndex.load(coarse_version.directory, Calibration()), explains=False),
                Simulator(small_world.vertices, small_world.triangles),
                BuildConfig.parse(COARSE_CONFIG).sensor_model,
                SelfTestConfig(queries=6, outside=6, **config),
                ActivateConfig(),
                RealScans(),
                executor,
                lambda done: None,
                lambda: False,
            )
        assert next(looks, None) is None
        return found, calibration

    return ask


def test_it_ends_at_the_look_where_nothing_is_open_and_says_so(asked):
    found, calibration = asked([(THRESHOLD, PLACES), ()])
    assert (found.queries, found.outside) == (5, 4)
    assert (found.parts["roughly"]["queries"], found.parts["as real"]["queries"]) == (2, 3)
    told = {"planned": 12, "share": round(9 / 12, 4), "ended": "decided"}
    assert found.asked == {**told, "still_open": [THRESHOLD, PLACES]}
    assert asked([(THRESHOLD, PLACES), ()]) == (found, calibration), "equal inputs give equal results"


@pytest.mark.slow
def test_it_asks_all_where_something_stays_open_or_the_config_wants_it(asked):
    looks = ROUNDS - FIRST_LOOK
    found, calibration = asked([(FOUND,)] * looks)
    assert (found.queries, found.outside) == (6, 6)
    assert found.asked == {"planned": 12, "share": 1.0, "ended": "all asked", "still_open": [FOUND]}
    whole, same = asked([()] * looks, until_decided=False)
    assert (whole.queries, whole.asked["ended"]) == (6, "all asked")
    assert same == calibration


@pytest.mark.slow
def test_where_only_the_map_is_left_to_know_no_stranger_and_no_prior_is_asked(asked):
    found, _ = asked([(TIES,), (TIES, PLACES), (PLACES,)])
    assert (found.queries, found.outside) == (6, 3)
    assert found.asked == {
        "planned": 12,
        "share": round(9 / 12, 4),
        "ended": "all asked",
        "still_open": [PLACES],
    }
    half, _ = asked([()])
    with_prior = [(one.with_prior["right"], one.with_prior["wrong"]) for one in (found, half)]
    assert with_prior[0] == with_prior[1]

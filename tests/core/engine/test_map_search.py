"""Steps of the effort levels, on a map whose searches are made up: order, deadline, and what is reused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.quality import AlignmentQuality
from firstfix.engine import localizer as localizer_module
from firstfix.engine import map_search as map_search_module
from firstfix.engine.calibration import Calibration
from firstfix.engine.config import EngineConfig
from firstfix.engine.map_search import MapSearch, Step
from firstfix.engine.ranking import RANKING
from firstfix.engine.stopwatch import Stopwatch


class Clock:
    """Seconds that pass only when work is done."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def monotonic(self) -> float:
        return self.now_s


@pytest.fixture
def clock(monkeypatch) -> Clock:
    made = Clock()
    monkeypatch.setattr("time.monotonic", made.monotonic)
    return made


@pytest.fixture
def search_by(monkeypatch, clock):
    """Returns a function that makes a search whose steps take 10 ms each and are noted in a list."""

    def make(
        options: LocalizeOptions,
        found_by: Step | None = None,
        calibration: Calibration = Calibration(),
    ):
        taken: list[Step] = []
        cascade = SimpleNamespace(templates=range(5000))
        hypotheses = SimpleNamespace(is_settled=False, explains_scan=False)
        monkeypatch.setattr(map_search_module, "HypothesisSearch", lambda *given: hypotheses)
        index = SimpleNamespace(config=EngineConfig(), calibration=calibration, cascade=cascade)
        search = MapSearch(
            index,
            SimpleNamespace(scans=("scan",), sparse=SimpleNamespace(time_s=None)),
            options,
            Stopwatch(options.deadline_from(100.0)),
        )

        def note(step: Step) -> None:
            taken.append(step)
            clock.now_s += 0.01
            good = found_by is not None and step is found_by
            quality = AlignmentQuality(0.99, 0.98, 0.0) if good else AlignmentQuality(0.3, 0.2, 0.2)
            features = RANKING.match_features([quality], calibration.min_margin)
            hypotheses.is_settled = hypotheses.explains_scan = calibration.ends_search(features)

        monkeypatch.setattr(
            search,
            "_by_descriptor",
            lambda levelled: note(Step.NARROW if levelled == ("scan",) else Step.OTHER_UPS),
        )
        monkeypatch.setattr(
            search,
            "_by_screening",
            lambda effort, tilted: note(Step.EXHAUSTIVE if tilted else Step.WIDE),
        )
        search._prepared.with_other_ups = lambda *given: ("scan", "head down")
        return search, taken

    return make


ALL = [Step.NARROW, Step.WIDE, Step.OTHER_UPS, Step.EXHAUSTIVE]


@pytest.mark.parametrize("number", range(4))
def test_the_search_ends_at_the_level_that_finds_the_place(search_by, number):
    search, taken = search_by(LocalizeOptions(), found_by=ALL[number])
    localizer_module._search([search])
    assert taken == ALL[: number + 1]


def test_a_localized_place_ends_the_search_by_the_maps_own_threshold(search_by):
    """Many maps may have taught a lower threshold: what is searched for less is less often right."""
    sure = Calibration(min_probability=0.9, search_until=0.9)
    search, taken = search_by(LocalizeOptions(), found_by=Step.NARROW, calibration=sure)
    localizer_module._search([search])
    assert taken == [Step.NARROW]
    search, taken = search_by(
        LocalizeOptions(), found_by=Step.NARROW, calibration=replace(sure, search_until=1.0)
    )
    localizer_module._search([search])
    assert taken[:2] == [Step.NARROW, Step.WIDE]


def test_a_scan_of_another_place_takes_every_step_once(search_by):
    search, taken = search_by(LocalizeOptions())
    localizer_module._search([search])
    assert taken == ALL


def test_a_map_that_explains_the_scan_ends_the_search_of_others(search_by):
    options = LocalizeOptions()
    (found, by_first), (other, by_other) = search_by(options, found_by=Step.WIDE), search_by(options)
    localizer_module._search([found, other])
    assert by_first == by_other == [Step.NARROW, Step.WIDE]


def test_limited_candidates_are_not_extended(search_by):
    search, taken = search_by(LocalizeOptions(max_candidates=5))
    localizer_module._search([search])
    assert taken == [Step.NARROW, Step.OTHER_UPS]


@pytest.mark.parametrize(
    ("deadline_ms", "steps"),
    [
        (1, [Step.NARROW]),  # there is always an answer
        (80, [Step.NARROW]),
        (150, [Step.NARROW, Step.OTHER_UPS]),
        (230, [Step.NARROW, Step.WIDE, Step.OTHER_UPS]),
        (450, ALL),
    ],
)
def test_a_step_begins_only_if_the_deadline_leaves_time_for_it(search_by, deadline_ms, steps):
    search, taken = search_by(LocalizeOptions(deadline_ms=deadline_ms))
    localizer_module._search([search])
    expected_ms = [round(1e3 * search._expected_s(step)) for step in ALL[1:]]
    assert expected_ms == [208, 90, 376]  # the first took 10 ms
    assert taken == steps


def test_the_mounting_tells_the_expected_up(search_by):
    turned = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    assert search_by(LocalizeOptions())[0]._expected_up().tolist() == [0, 0, 1]
    assert search_by(LocalizeOptions(T_base_sensor=turned))[0]._expected_up().tolist() == [0, 1, 0]
    assert search_by(LocalizeOptions(gravity=np.array([0, 0, -9.8])))[0]._expected_up() is None

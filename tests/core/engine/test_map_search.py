"""Time that a step of the effort levels may take. The steps themselves: ``tests/e2e/test_ladder.py``."""

import math

import pytest

from firstfix import native
from firstfix.engine.config import SearchConfig
from firstfix.engine.map_search import Step


def test_a_step_takes_as_long_as_its_work_by_the_time_of_the_first():
    later = [Step.WIDE, Step.OTHER_UPS, Step.EXHAUSTIVE]
    expected_s = [native.expected_s(step, SearchConfig(), 0.01) for step in later]
    assert expected_s == pytest.approx([0.2075, 0.09, 0.37625])
    assert native.expected_s(Step.NARROW, SearchConfig(), 0.01) == -math.inf, "there is always an answer"


def test_a_step_with_more_work_takes_longer():
    search = SearchConfig()
    more = search.model_copy(update={"wide": search.exhaustive})
    assert native.expected_s(Step.WIDE, more, 0.01) == native.expected_s(Step.EXHAUSTIVE, search, 0.01)
    fewer = search.model_copy(update={"candidates": 2 * search.candidates})
    assert native.expected_s(Step.WIDE, fewer, 0.01) == pytest.approx(
        native.expected_s(Step.WIDE, search, 0.005)
    )

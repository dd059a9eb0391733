"""Reasons not to merge, each from findings that are right but for one."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from firstfix_builder.sources.sessions.agreement import Agreement, Consensus
from firstfix_builder.sources.sessions.ask_places import AskedPlace
from firstfix_builder.sources.sessions.check import SharedPlace
from firstfix_builder.sources.sessions.join import Overlap
from firstfix_builder.sources.sessions.place_session import bent, no_consensus, not_one_place

VOTES = [AskedPlace(np.array([float(n), 0, 0]), np.eye(4)[None], np.array([0.7]), True) for n in range(20)]
FOUND = Consensus(np.eye(4), np.arange(12), 8.4, 1.0)
AGREEMENT = Agreement(20, 10, 12, 14, 12, np.full(10, 0.05), np.zeros((10, 3)))
OVERLAP = Overlap(0.4, 0.01, np.zeros((5, 3)))
PLACE = SharedPlace(np.zeros(3), 3000, 0.9, (250, 30), (0.02, 0.2))


def test_right_findings_are_not_refused():
    assert no_consensus(VOTES, FOUND) is None
    assert not_one_place(AGREEMENT, OVERLAP, [PLACE] * 20) is None
    assert bent(AGREEMENT, [PLACE] * 20) is None


@pytest.mark.parametrize(
    ("found", "why"),
    [
        (None, "too little overlap: 20 places"),
        (replace(FOUND, agreeing=np.arange(4)), "too little overlap"),
        (replace(FOUND, votes=3.0), "3.0 votes, and 5 votes of 5 places"),
        (replace(FOUND, rival_votes=5.0), "ambiguous: .* 8.4 and 5.0 votes"),
    ],
)
def test_a_transform_of_too_few_places_is_refused(found, why):
    assert re.search(why, no_consensus(VOTES, found))


@pytest.mark.parametrize(
    ("agreement", "overlap", "place", "why"),
    [
        (AGREEMENT, replace(OVERLAP, share=0.02), PLACE, "too little overlap: 2%"),
        (replace(AGREEMENT, in_both=40), OVERLAP, PLACE, "of 40 places where both have been, only 12"),
        (AGREEMENT, OVERLAP, replace(PLACE, same=0.5), "only 50% of the view"),
        (AGREEMENT, OVERLAP, replace(PLACE, movable=(60, 200)), "another storey: only 23%"),
        (AGREEMENT, replace(OVERLAP, residual_m=0.15), PLACE, "0.15 m apart"),
    ],
)
def test_sessions_of_two_places_are_refused(agreement, overlap, place, why):
    assert why in not_one_place(agreement, overlap, [place] * 20)


def test_a_place_with_hardly_a_thing_is_not_judged_by_things():
    assert not_one_place(AGREEMENT, OVERLAP, [replace(PLACE, movable=(5, 30))] * 20) is None


def test_a_bend_is_told_with_its_worst_place():
    worst = replace(PLACE, position_m=np.array([12.5, -3.0, 0.9]), offset=(0.62, 2.5))
    off = replace(PLACE, offset=(0.3, 0.5))
    assert bent(AGREEMENT, [PLACE] * 17 + [off, off, worst]) is None  # a tenth may be
    said = bent(AGREEMENT, [PLACE] * 15 + [off] * 4 + [worst])
    assert "5 of 30 places are off, most at (12.5, -3.0, 0.9) m by 0.62 m and 2.5 degrees" in said


def test_answers_that_stray_in_one_direction_bend_too_and_mistakes_far_off_do_not():
    astray = replace(AGREEMENT, astray_m=np.array([0.05] * 5 + [0.8] * 5))
    assert "bent" in bent(astray, [PLACE] * 20)
    assert bent(replace(astray, astray_m=np.array([0.05] * 5 + [40.0] * 5)), [PLACE] * 20) is None

"""A symmetric hall: a right prior localizes, a wrong one never does."""

from __future__ import annotations

import pytest

from firstfix_lab.suites.priors.halls import HALLS
from firstfix_lab.suites.priors.suite import BuiltHall, measure


@pytest.mark.slow
def test_in_a_hall_that_is_the_same_after_half_a_turn_only_a_right_prior_localizes():
    found = measure(BuiltHall.of(HALLS["shed"]()), 4, seed=77)
    for kind, counts in found.items():
        if kind.endswith("right"):
            assert counts["right"] == counts["asked"], kind
        else:
            assert counts["right"] == counts["false"] == 0, kind
    assert found["1.0 m, right"]["asked"] == found["twin with the true heading, wrong"]["asked"] == 4


def test_the_halls_are_as_symmetric_as_they_say():
    for make in HALLS.values():
        hall = make()
        corners = {tuple(round(v, 6) for v in vertex) for vertex in hall.mesh.vertices.tolist()}
        for turn_deg, x, y in hall.symmetries:
            turned = set()
            for px, py, pz in corners:
                dx, dy = px - x, py - y
                dx, dy = {90: (-dy, dx), 180: (-dx, -dy), 270: (dy, -dx)}[int(turn_deg)]
                turned.add((round(dx + x, 6), round(dy + y, 6), pz))
            assert {(px, py) for px, py, pz in turned if pz == 4} == {
                (px, py) for px, py, pz in corners if pz == 4
            }

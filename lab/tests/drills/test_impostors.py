"""A sample of the drill: ``firstfix-lab impostors`` asks 3,000 times, in larger worlds too."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.transform import make_transform, rotation_z
from firstfix_lab.drills.impostor_worlds import MOTIONS, motion_of, storeys
from firstfix_lab.drills.impostors import Table, judged, run

pytestmark = pytest.mark.slow

HERE = make_transform(rotation_z(0.3), [1.0, 2.0, 0.8])
NEXT = make_transform(np.eye(3), [0, 0, 3.4]) @ HERE


@pytest.mark.timeout(900)  # it builds a version
def test_a_moving_robot_is_not_taken_to_another_room_storey_or_wing():
    table = Table()
    run(storeys(), "storeys", table, count=12, seed=1)
    assert table.total("answers") == 12 * len(MOTIONS)
    assert table.total("false") == 0, "\n".join(table.examples)
    assert table.total("ambiguous") + table.total("right") > table.total("rejected")


def localized(T_map_sensor) -> Localization:
    return Localization(
        Verdict.LOCALIZED,
        T_map_sensor=T_map_sensor,
        probability=0.999,
        hypotheses=(Hypothesis(T_map_sensor, None, 0.999, 0, ""),),
    )


def test_answers_are_counted_by_their_verdict_and_the_truth():
    one, other = Hypothesis(NEXT, None, 0.5, 0, ""), Hypothesis(NEXT, None, 0.93, 0, "")
    ambiguous = Localization(Verdict.AMBIGUOUS, (Reason.SEVERAL_PLACES,), hypotheses=(one,))
    rejected = Localization(Verdict.REJECTED, (Reason.LOW_PROBABILITY,), hypotheses=(other,))
    assert judged(localized(HERE), HERE) == ["right"]
    assert judged(localized(NEXT), HERE) == ["false"]
    assert judged(localized(HERE @ make_transform(rotation_z(0.5), [0, 0, 0])), HERE) == ["false"]
    assert judged(ambiguous, HERE) == ["ambiguous"]
    assert judged(rejected, HERE) == ["rejected", "doubted"]
    table = Table()
    table.add("storeys", "both", localized(NEXT), HERE)
    assert table.total("false") == 1
    assert "3.40 m" in table.examples[0]


def test_a_robot_moves_on_its_floor_as_the_drill_says():
    rng = np.random.default_rng(3)
    for kind in MOTIONS:
        twists = np.array([motion_of(kind, rng).twist for _ in range(200)])
        speeds = np.hypot(twists[:, 0], twists[:, 1])
        turns = np.degrees(np.abs(twists[:, 5]))
        assert (speeds.max() > 1.2) == (kind != "turning")
        assert (turns.max() > 100) == (kind != "straight")
        assert not twists[:, 2:5].any()
        assert speeds.max() <= 1.5
        assert turns.max() <= 120

"""The text of an answer on the terminal."""

from __future__ import annotations

import numpy as np

from firstfix.answer.hint import Hint
from firstfix.answer.localization import Localization, Verdict
from firstfix_cli.commands.localize import lines_of


def test_an_ambiguous_answer_says_how_to_become_sure():
    T_sensor_goal = np.eye(4)
    T_sensor_goal[:2, 3] = 1.5, 1.5
    hint = Hint(T_sensor_goal, distance_m=2.12, turn_deg=-30.0, separation=0.4, tells_apart=(0, 1))
    answer = Localization(Verdict.AMBIGUOUS, probability=0.9, hint=hint)
    way = "drive 2.1 m to 45 deg (0 ahead, 90 left), turn 30 deg to the right"
    assert f"  next    {way}, and ask again with both scans" in lines_of(answer)
    still = Hint(np.eye(4), distance_m=0.0, turn_deg=90.0, separation=0.4, tells_apart=(0, 1))
    wanted = "  next    turn 90 deg to the left, and ask again with both scans"
    assert wanted in lines_of(Localization(Verdict.AMBIGUOUS, probability=0.9, hint=still))

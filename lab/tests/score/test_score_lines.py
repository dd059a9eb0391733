"""The metrics of a system's answers, as a person reads them."""

from __future__ import annotations

from firstfix_lab.score.lines import lines_of
from firstfix_lab.score.metrics import report_of
from firstfix_lab.score.scored import Scored


def test_each_success_rate_is_told_once():
    lines = lines_of(report_of([Scored(True, 0.1, 0.5, True, True, 0.9, 0.02), Scored(True)]))
    (success,) = [line for line in lines if "accepted and right" in line]
    assert success.split("    ")[1] == (
        "50.0% within 0.2 m, 1 deg, 50.0% within 1 m, 5 deg, 50.0% within 2 m, 5 deg"
    )

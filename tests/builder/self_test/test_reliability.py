from dataclasses import replace

import numpy as np

from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import Calibration
from firstfix.engine.ranking import MatchFeatures
from firstfix_builder.self_test.reliability import (
    ABSENT_WEIGHT,
    Case,
    CrossValidated,
    fit,
)

TRUE = Calibration(bias=-12.0, alignment_score=3.0, free_space=1.5, margin=15.0)


def cases(n: int, seed: int, honest: bool = True) -> list[Case]:
    """Drawn from the model; dishonest: their truth is a coin's."""
    rng = np.random.default_rng(seed)
    drawn = []
    for query in range(n):
        evidence = MatchFeatures(
            AlignmentQuality(0.9, rng.uniform(0.3, 1), rng.exponential(0.03)), float(rng.uniform(0, 0.5))
        )
        drawn.append(
            Case(query, evidence, bool(rng.random() < (TRUE.probability(evidence) if honest else 0.5)))
        )
    return drawn


def test_honest_cases_are_reliable_and_every_case_is_counted():
    found = CrossValidated.of(cases(1500, 1)).reliability()
    assert found["expected_calibration_error"] < 0.05
    assert sum(part["cases"] for part in found["bins"]) == 1500
    assert all(0 <= part["claimed"] <= 1 and 0 <= part["right"] <= 1 for part in found["bins"])


def test_too_few_cases_to_learn_a_coin_from_are_called_unreliable():
    assert CrossValidated.of(cases(25, 2, honest=False)).reliability()["expected_calibration_error"] > 0.1


def test_what_was_not_asked_teaches_but_is_not_counted():
    asked = cases(200, 3)
    twins = [Case(c.query, MatchFeatures(c.evidence.quality, 0.01), False, 0.25, asked=False) for c in asked]
    found = CrossValidated.of(asked + twins).reliability()
    assert sum(part["cases"] for part in found["bins"]) == 200
    assert fit(asked + twins).probability(twins[0].evidence) < fit(asked).probability(twins[0].evidence)


def test_equal_places_do_not_move_the_calibration_of_others():
    asked = cases(200, 5)
    ties = [
        Case(200 + c.query, MatchFeatures(c.evidence.quality, 0.4, tied=2), c.query % 2 == 0) for c in asked
    ]
    assert replace(fit(asked + ties), among_tied=()) == fit(asked)
    assert replace(fit(ties), among_tied=()) == Calibration()
    found = CrossValidated.of(asked + ties).reliability()
    assert sum(part["cases"] for part in found["bins"]) == 400  # that they come true is still measured


def test_equal_places_teach_how_likely_one_of_them_is_right():
    """In a building of equal storeys a weak scan finds both, whatever the prior expects of such a fit."""
    weak = MatchFeatures(AlignmentQuality(0.85, 0.84, 0.0, 0.01, 0.15, 0.2), 0.06, tied=2)
    absent = MatchFeatures(AlignmentQuality(0.5, 0.4, 0.01, 0.02, 0.2, 0.1), 0.02, tied=2)
    assert Calibration().probability(weak) < 0.5
    found = [Case(query, weak, True) for query in range(100)]
    missed = [Case(query, absent, False, ABSENT_WEIGHT, asked=False) for query in range(100)]
    taught = fit(found + missed)
    assert taught.probability(weak) > 0.9
    assert taught.probability(absent) < 0.1
    alone = replace(weak, tied=1)
    assert taught.probability(alone) == Calibration().probability(alone)


def test_nothing_asked_leaves_the_prior_and_no_claim():
    assert fit([]) == Calibration()
    assert CrossValidated.of([]).reliability() == {"expected_calibration_error": None, "bins": []}


def test_the_bound_counts_wrong_cases_asked_or_not_and_those_without_an_answer():
    asked = cases(200, 6)
    wrong = [case for case in asked if not case.right]
    absent = [Case(c.query, MatchFeatures(c.evidence.quality, 0.01), False, 0.25, asked=False) for c in asked]
    found = CrossValidated.of([*asked, *absent]).bound(unanswered=7)
    assert found.negatives == len(wrong) + len(absent) + 7
    alone = CrossValidated.of(asked).bound()
    assert alone.negatives == len(wrong)
    assert all(
        row.accepted <= other.accepted + len(absent)
        for row, other in zip(found.rows, alone.rows, strict=True)
    )


def test_the_bound_is_judged_by_a_calibration_that_has_not_seen_the_case():
    """One query is wrong with the best of evidence: a model that was fitted to it would believe it less."""
    good = [
        Case(n, MatchFeatures(AlignmentQuality(0.95, 0.9, 0.001), 0.3 + 0.001 * n), True) for n in range(40)
    ]
    liar = Case(40, MatchFeatures(AlignmentQuality(0.95, 0.9, 0.001), 0.2), False, weight=50.0)
    unseen, seen = fit(good), fit([*good, liar])
    threshold = [row for row in CrossValidated.of([*good, liar]).bound().rows if row.accepted]
    assert threshold[-1].min_probability <= unseen.probability(liar.evidence)
    assert threshold[-1].min_probability > seen.probability(liar.evidence)


def test_what_no_threshold_accepts_is_no_false_accept():
    """Places that tie, and such as do not explain the scan."""
    quality = AlignmentQuality(0.95, 0.95, 0.0)
    tied = [Case(n, MatchFeatures(quality, 0.5, tied=2), False) for n in range(10)]
    little = [Case(n, MatchFeatures(AlignmentQuality(0.3, 0.95, 0.0), 0.5), False) for n in range(10, 20)]
    assert [row.accepted for row in CrossValidated.of([*tied, *little]).bound().rows] == [0] * 10

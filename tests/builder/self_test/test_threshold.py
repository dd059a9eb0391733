"""The choice of a map's threshold: exact figures, monotone in the promise, and nothing wrong above it."""

import numpy as np
import pytest

from firstfix_builder.self_test.threshold import FLOOR, Ceiling, Judged, choose, is_settled


def cases(in_map: list[float], wrong: list[float], absent: list[float]) -> list[Judged]:
    """By claimed probability: right ones in the map, wrong ones there, and those of places that it lacks."""
    return [
        *(Judged(claim, True, True) for claim in in_map),
        *(Judged(claim, False, True) for claim in wrong),
        *(Judged(claim, False, False) for claim in absent),
    ]


def test_the_rate_is_shown_by_enough_cases():
    found = choose(cases([0.9999] * 100 + [0.93] * 20, [], [0.5] * 199 + [0.92]), 0.005, None)
    assert (found.min_probability, found.kept_by) == (0.95, "rate")  # 0.9 would accept one of the absent
    assert found.localized == round(100 / 120, 4)
    of_negatives = 1 - 0.05 ** (1 / 200)
    wanted = of_negatives / 9 / (of_negatives / 9 + 8 / 9 * 100 / 120)
    assert wanted <= found.bound <= wanted + 2e-6


def test_how_sure_the_answers_claim_to_be_does_not_count():
    """The cases are the evidence: claims below the promise that were all right are no reason against it."""
    found = choose(cases([0.93] * 120, [], [0.5] * 200), 0.005, None)
    assert (found.min_probability, found.localized, found.kept_by) == (FLOOR, 1.0, "rate")


def test_where_few_cases_show_no_rate_each_answer_keeps_the_promise():
    found = choose(cases([0.9999] * 20, [], [0.1] * 20), 0.005, None)
    assert (found.min_probability, found.kept_by) == (0.995, "each answer")
    assert found.bound > 0.005
    assert choose([], 0.005, None).min_probability == 0.995
    assert choose([], 0.1, None).min_probability == FLOOR


@pytest.mark.parametrize("worst", [0.3, 0.92, 0.9951, 0.99999, 1.0])
def test_no_wrong_case_is_accepted(worst: float):
    for wrong, absent in (([worst], []), ([], [worst])):
        for share in (0.1, 0.01, 0.005, 0.001):
            found = choose(cases([0.9999999] * 400, wrong, [0.2] * 300 + absent), share, None)
            assert found.min_probability > worst or worst == 1.0
            assert FLOOR <= found.min_probability <= 1


@pytest.mark.parametrize("seed", range(20))
def test_a_larger_promise_never_needs_a_higher_threshold(seed: int):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(5, 600))
    drawn = cases(
        (1 - 0.05 * rng.beta(0.2, 2, n)).tolist(),
        rng.beta(0.5, 4, int(rng.integers(0, 20))).tolist(),
        rng.beta(0.3, 6, int(rng.integers(0, 400))).tolist(),
    )
    shares = np.geomspace(1e-4, 0.1, 40).tolist()
    found = [choose(drawn, share, None) for share in shares]
    thresholds = [one.min_probability for one in found]
    assert thresholds == sorted(thresholds, reverse=True)
    assert [one.localized for one in found] == sorted(one.localized for one in found)
    assert all(one.bound <= one.max_false_accept for one in found if one.kept_by == "rate")
    assert min(thresholds) >= FLOOR


def test_the_most_probable_wrong_case_of_one_map_does_not_lift_it_above_the_ceiling():
    hard = cases([0.9999] * 60 + [0.993] * 60, [], [0.5] * 100 + [0.9998])
    alone, taught = choose(hard, 0.005, None), choose(hard, 0.005, Ceiling(0.99, 0.004))
    assert (alone.min_probability, alone.localized) == (0.999801, 0.5)
    assert (taught.min_probability, taught.localized) == (0.99, 1.0)
    assert (taught.kept_by, taught.bound) == ("many maps", 0.004)


def test_a_map_that_shows_its_own_rate_keeps_its_own_threshold():
    shown = cases([0.9999] * 100 + [0.93] * 20, [], [0.5] * 199 + [0.92])
    assert choose(shown, 0.005, Ceiling(0.99, 0.004)) == choose(shown, 0.005, None)


@pytest.mark.parametrize(("wrong", "kept_by"), [(1, "many maps"), (4, "each answer")])
def test_scans_that_were_asked_may_refute_the_ceiling(wrong: int, kept_by: str):
    """One of 121 localized at the wrong place is no proof against 1 in 200; four are."""
    found = choose(cases([0.9999] * 117, [0.999] * wrong, []), 0.005, Ceiling(0.99, 0.004))
    assert found.kept_by == kept_by


def test_hard_negatives_that_nobody_asked_refute_nothing():
    hard = [Judged(0.9995, False, False, 0.1, asked=False)] * 20
    found = choose([*cases([0.9999] * 117, [], []), *hard], 0.005, Ceiling(0.99, 0.004))
    assert found.kept_by == "many maps"


def half(claimed: list[float], absent: list[float]) -> list[Judged]:
    """Half of a self-test's cases, all of whose places in the map are right."""
    return cases(claimed, [], absent)


def test_half_of_the_cases_choose_what_all_would_if_they_came_out_alike():
    some = half([0.9999] * 50 + [0.93] * 10, [0.5] * 60)
    early, whole = choose(some, 0.005, None, 0.5), choose([*some, *some], 0.005, None)
    assert early.min_probability == whole.min_probability == FLOOR
    assert is_settled(some, 0.005, None, 0.5)
    assert choose(some, 0.005, None).min_probability == 0.995, "as a whole self-test it would be too small"


def test_the_bound_of_half_of_the_cases_is_told_as_it_is():
    some = half([0.9999] * 60, [0.5] * 60)
    early, whole = choose(some, 0.005, None, 0.5), choose([*some, *some], 0.005, None)
    assert whole.bound < early.bound + 0.002
    assert early.kept_by == "rate"
    assert early.bound <= 0.005
    fewer = choose(half([0.9999] * 60, [0.5] * 40), 0.005, None, 0.5)
    assert fewer.bound > early.bound, "fewer negatives show less"


def test_a_threshold_is_not_settled_while_its_own_cases_do_not_carry_it():
    """All of them would show the rate at 0.9, so few do not yet: it goes on."""
    few = half([0.9999] * 20, [0.5] * 20)
    assert not is_settled(few, 0.005, None, 1 / 6)
    assert choose(few, 0.005, None, 1 / 6).min_probability == 0.995


def test_what_no_further_case_can_lower_is_settled():
    """A negative above the ceiling: whatever the rest is, the threshold is what many maps have taught."""
    some = half([0.9999] * 20, [0.5] * 20 + [0.9998])
    assert is_settled(some, 0.005, Ceiling(0.99, 0.004), 1 / 6)
    assert choose(some, 0.005, Ceiling(0.99, 0.004), 1 / 6).kept_by == "many maps"


def test_an_early_end_never_tells_a_lower_threshold_than_all_cases_like_these_would():
    rng = np.random.default_rng(5)
    for _ in range(40):
        n = int(rng.integers(10, 80))
        some = half((1 - 0.05 * rng.beta(0.2, 2, n)).tolist(), rng.beta(0.3, 6, n).tolist())
        early, whole = choose(some, 0.005, None, 0.5), choose([*some, *some], 0.005, None)
        assert early.min_probability >= whole.min_probability

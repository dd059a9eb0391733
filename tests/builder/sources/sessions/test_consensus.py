from __future__ import annotations

import numpy as np

from firstfix.transform import make_transform, rotation_z
from firstfix_builder.sources.sessions.agreement import consensus_of
from firstfix_builder.sources.sessions.ask_places import AskedPlace

T_TRUE = make_transform(rotation_z(2.0), [30.0, -12.0, 0.4])


def asked(position_m, *hypotheses):
    return AskedPlace(
        np.array(position_m, float),
        np.array([T for T, _ in hypotheses]).reshape(-1, 4, 4),
        np.array([probability for _, probability in hypotheses], float),
        localized=True,
    )


def a_little_off(rng, position_m, sigma_m=0.1, sigma_deg=0.2):
    """The truth, as a scan at a place measures it."""
    about = make_transform(np.eye(3), position_m)
    error = make_transform(rotation_z(np.radians(rng.normal(0, sigma_deg))), rng.normal(0, sigma_m, 3))
    return T_TRUE @ about @ error @ np.linalg.inv(about)


def anywhere(rng):
    return make_transform(rotation_z(rng.uniform(-3, 3)), rng.uniform(-50, 50, 3))


def test_the_places_that_agree_win_over_more_that_do_not():
    rng = np.random.default_rng(1)
    at = rng.uniform(-20, 20, (30, 3)) * [1, 1, 0.05]
    right = [asked(p, (anywhere(rng), 0.3), (a_little_off(rng, p), 0.6)) for p in at[:10]]
    wrong = [asked(p, (anywhere(rng), 0.9)) for p in at[10:]]
    found = consensus_of([*wrong, *right])
    np.testing.assert_array_equal(found.agreeing, np.arange(20, 30))
    assert np.isclose(found.votes, 6.0)
    assert found.rival_votes < 2.5
    middle = at[:10].mean(axis=0)
    assert np.linalg.norm((found.T_known_asked - T_TRUE)[:3] @ [*middle, 1]) < 0.5


def test_a_place_votes_once():
    rng = np.random.default_rng(2)
    p = np.zeros(3)
    found = consensus_of([asked(p, *[(a_little_off(rng, p), 0.2)] * 5)])
    assert np.isclose(found.votes, 0.2)


def test_two_positions_that_fit_alike_are_rivals():
    rng = np.random.default_rng(3)
    beside = make_transform(np.eye(3), [8.0, 0, 0])  # a bay further
    places = [
        asked(p, (a_little_off(rng, p), 0.5), (beside @ a_little_off(rng, p), 0.45))
        for p in rng.uniform(-10, 10, (12, 3))
    ]
    found = consensus_of(places)
    assert np.isclose(found.votes, 6.0)
    assert np.isclose(found.rival_votes, 5.4)


def test_the_other_way_round_is_a_rival():
    turned = make_transform(rotation_z(np.pi), [0.0, 0, 0])
    p = np.zeros(3)
    found = consensus_of([asked(p, (np.eye(4), 0.6), (turned, 0.4))])
    assert np.isclose(found.rival_votes, 0.4)


def test_without_hypotheses_there_is_no_consensus():
    assert consensus_of([]) is None
    assert consensus_of([asked(np.zeros(3))]) is None
    assert consensus_of([asked(np.zeros(3), (np.eye(4), 0.001))]) is None

"""Comparison of the localized places of a session with the transform that the registration found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import Matrix, inverse

from .ask_places import AskedPlace
from .check import rows_in_both
from .session_map import PlacedSession


@dataclass(frozen=True)
class Agreement:
    """Agreement of the asked places with the transform that the registration found.

    Attributes:
        asked: number of places that were asked.
        localized: number of these that were localized.
        agreeing: number of these with a hypothesis that agrees with the transform.
        in_both: number of asked places at which a placed session has been, too.
        agreeing_in_both: number of these that agree.
        astray_m: (n,) errors of the localized places in both sessions, by the transform.
        position_m: (n, 3) these places.
    """

    asked: int
    localized: int
    agreeing: int
    in_both: int
    agreeing_in_both: int
    astray_m: NDArray[np.float64]
    position_m: NDArray[np.float64]

    @classmethod
    def of(cls, votes: Sequence[AskedPlace], placed: Sequence[PlacedSession], T: Matrix) -> Agreement:
        """Compare the places' hypotheses with a transform to the first session.

        Args:
            votes: one for each place and placed session that was asked about it.
        """
        places = {tuple(place.position_m): False for place in votes}
        both = set()
        for one in placed:
            at = np.array(list(places))
            both |= {
                tuple(at[row]) for row in rows_in_both(at, one.session, inverse(one.T_first_session) @ T)
            }
        astray, where = [], []
        for place in votes:
            if not len(place.probability):
                continue
            at = np.tile(place.position_m, (len(place.probability), 1))
            yes = agrees(place.T_known_asked, T, at, place.position_m)
            places[tuple(place.position_m)] |= bool(yes.any())
            if place.localized and tuple(place.position_m) in both:
                astray.append(
                    float(np.linalg.norm((place.T_known_asked[0] - T)[:3] @ [*place.position_m, 1]))
                )
                where.append(place.position_m)
        return cls(
            len(places),
            len({tuple(place.position_m) for place in votes if place.localized}),
            sum(places.values()),
            len(both),
            sum(agree for place, agree in places.items() if place in both),
            np.array(astray),
            np.array(where).reshape(-1, 3),
        )


NEAR_M = 0.5  # error of one place by the transform of another, at most,
NEAR_PER_M = 0.012  # and for each metre between them: the heading of a fix has errors of about 0.5 degrees
NEAR_DEG = 4.0
MIN_PROBABILITY = 0.05  # of a hypothesis whose transform others may vote for


@dataclass(frozen=True)
class Consensus:
    """A transform and its votes.

    Attributes:
        T_known_asked: (4, 4).
        agreeing: rows of the places that agree, ascending.
        votes: sum of their probabilities.
        rival_votes: votes of the best different transform.
    """

    T_known_asked: Matrix
    agreeing: NDArray[np.int64]
    votes: float
    rival_votes: float


def consensus_of(places: Sequence[AskedPlace]) -> Consensus | None:
    """The transform with the most votes. Each place has one vote for each transform that it agrees with.

    The weight of a vote is the probability of the hypothesis that agrees. None: there is no hypothesis.
    """
    owner = np.repeat(np.arange(len(places)), [len(place.probability) for place in places]).astype(np.int64)
    if not len(owner):
        return None
    T = np.concatenate([place.T_known_asked for place in places])
    probability = np.concatenate([place.probability for place in places])
    position_m = np.stack([place.position_m for place in places])[owner]
    seeds = np.flatnonzero(probability >= MIN_PROBABILITY)
    if not len(seeds):
        return None
    ballots = np.stack([_ballot(T, position_m, probability, owner, len(places), int(seed)) for seed in seeds])
    votes = ballots.sum(axis=1)
    best = int(np.argmax(votes))
    for_it = np.flatnonzero(ballots[best] > 0)
    others = ~np.array([_same(T[seed], T[seeds[best]], position_m[seed]) for seed in seeds])
    rival = float(votes[others].max()) if others.any() else 0.0
    return Consensus(T[seeds[best]], for_it, float(votes[best]), rival)


def agrees(
    T_one: NDArray[np.float64], T_other: Matrix, position_m: NDArray[np.float64], from_m: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """For each of (n, 4, 4) transforms whether the other one moves the (n, 3) position equally.

    Args:
        from_m: (3,) position at which the other one was measured: errors of its heading grow with the
            distance.
    """
    here = np.einsum("nij,nj->ni", T_one[:, :3, :3], position_m) + T_one[:, :3, 3]
    there = position_m @ T_other[:3, :3].T + T_other[:3, 3]
    limit_m = NEAR_M + NEAR_PER_M * np.linalg.norm(position_m - from_m, axis=1)
    cosine = (np.einsum("nij,ij->n", T_one[:, :3, :3], T_other[:3, :3]) - 1) / 2
    near: NDArray[np.bool_] = np.linalg.norm(here - there, axis=1) <= limit_m
    return near & (cosine >= np.cos(np.radians(NEAR_DEG)))


def _ballot(
    T: NDArray[np.float64],
    position_m: NDArray[np.float64],
    probability: NDArray[np.float64],
    owner: NDArray[np.int64],
    places: int,
    seed: int,
) -> NDArray[np.float64]:
    """(places,) the vote of each place for the transform of one hypothesis."""
    yes = agrees(T, T[seed], position_m, position_m[seed])
    votes = np.zeros(places)
    np.maximum.at(votes, owner[yes], probability[yes])
    return votes


def _same(T_one: Matrix, T_other: Matrix, position_m: NDArray[np.float64]) -> bool:
    """Whether two transforms differ by no more than the errors of two places may."""
    away_m = np.linalg.norm((T_one - T_other)[:3] @ [*position_m, 1.0])
    cosine = (np.sum(T_one[:3, :3] * T_other[:3, :3]) - 1) / 2
    return bool(away_m <= 4 * NEAR_M) and bool(cosine >= np.cos(np.radians(2 * NEAR_DEG)))

"""The transform between two sessions that most localized places agree on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import Matrix

from .ask_places import AskedPlace

NEAR_M = 0.5  # places that agree put each other within this,
NEAR_PER_M = 0.012  # and this for each metre between them: a scan's heading is known to some 0.5 degrees
NEAR_DEG = 4.0
MIN_PROBABILITY = 0.05  # of a hypothesis that may be what others agree with


@dataclass(frozen=True)
class Consensus:
    """A transform, and who is for it.

    Attributes:
        T_known_asked: (4, 4).
        agreeing: rows of the places that agree, ascending.
        votes: sum of their probabilities.
        rival_votes: those of the best transform that is another one.
    """

    T_known_asked: Matrix
    agreeing: NDArray[np.int64]
    votes: float
    rival_votes: float


def consensus_of(places: Sequence[AskedPlace]) -> Consensus | None:
    """The transform with the most votes. Every place votes once for each transform it agrees with.

    A vote counts as much as the probability of the hypothesis that agrees. None: no place was localized.
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
    """Returns whether each of (n, 4, 4) transforms puts its own (n, 3) position where the other one does.

    Args:
        from_m: (3,) where the other one was measured: the further away, the more its heading matters.
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
    """Returns whether two transforms differ by no more than the errors of two places may."""
    away_m = np.linalg.norm((T_one - T_other)[:3] @ [*position_m, 1.0])
    cosine = (np.sum(T_one[:3, :3] * T_other[:3, :3]) - 1) / 2
    return bool(away_m <= 4 * NEAR_M) and bool(cosine >= np.cos(np.radians(2 * NEAR_DEG)))

"""Comparison of the localized places of a session with the transform that the registration found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.transform import Matrix, inverse

from .ask_places import AskedPlace
from .check import rows_in_both
from .consensus import agrees
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
        """Compares the places' hypotheses with a transform to the first session.

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

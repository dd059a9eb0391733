"""Finds the transform of a session to the placed ones, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from firstfix.engine.registration.surface import Surface
from firstfix.transform import Matrix, inverse

from .agreement import Agreement
from .ask_places import AskedPlace, ask_places
from .check import SharedPlace, shared_places
from .consensus import Consensus, consensus_of
from .join import Overlap, PlacedSurface
from .refusal import bent, movable_shares, no_consensus, not_one_place
from .session_map import PlacedSession, SessionMap


@dataclass(frozen=True)
class Placement:
    """Transform of a session, with the figures that support it.

    Attributes:
        T_first_session: (4, 4), between levelled frames.
        evidence: figures for the record, JSON.
    """

    T_first_session: Matrix
    evidence: dict[str, Any]


@dataclass(frozen=True)
class NotPlaced:
    """The reason why a session was not placed, as text for the user."""

    reason: str


def place_session(
    session: SessionMap,
    placed: Sequence[PlacedSession],
    executor: Executor,
    cancelled: Callable[[], bool],
) -> Placement | NotPlaced:
    """Localizes scans of the session in the placed ones, registers the clouds, and checks the result.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    votes = [
        AskedPlace(
            place.position_m, one.T_first_session @ place.T_known_asked, place.probability, place.localized
        )
        for one in placed
        for place in ask_places(session, one.session, executor, cancelled)
    ]
    found = consensus_of(votes)
    refused = no_consensus(votes, found)
    if refused is not None or found is None:
        return NotPlaced(refused or "none of its places was localized")
    surface = Surface.together([one.session.surface.moved(one.T_first_session) for one in placed])
    joined = PlacedSurface(surface)
    T_first_session = joined.join(session.surface, found.T_known_asked)
    overlap = joined.overlap(session.surface, T_first_session)
    shared = [
        place
        for one in placed
        for place in shared_places(
            session,
            one.session.localizer.index.surface,
            one.session,
            inverse(one.T_first_session) @ T_first_session,
        )
    ]
    asked = Agreement.of(votes, placed, T_first_session)
    evidence = _evidence(found, asked, overlap, shared)
    refused = not_one_place(asked, overlap, shared) or bent(asked, shared)
    return NotPlaced(refused) if refused else Placement(T_first_session, evidence)


def _evidence(
    found: Consensus,
    asked: Agreement,
    overlap: Overlap,
    shared: Sequence[SharedPlace],
) -> dict[str, Any]:
    """Figures for the record, rounded: the digest of a version must not depend on their last bits."""
    offsets = [place.offset for place in shared if place.offset is not None]
    return {
        "places_asked": asked.asked,
        "places_localized": asked.localized,
        "places_agreeing": asked.agreeing,
        "votes": round(found.votes, 2),
        "rival_votes": round(found.rival_votes, 2),
        "places_in_both": asked.in_both,
        "agreeing_in_both": asked.agreeing_in_both,
        "overlap": round(overlap.share, 3),
        "residual_m": round(overlap.residual_m, 4),
        "same_view": round(float(np.median([p.same for p in shared])), 3) if shared else 0.0,
        "things": round(movable_shares(shared)[0], 3),
        "things_same": round(movable_shares(shared)[1], 3),
        "largest_offset_m": round(max((o[0] for o in offsets), default=0.0), 3),
        "largest_offset_deg": round(max((o[1] for o in offsets), default=0.0), 3),
    }

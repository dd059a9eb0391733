"""Finds the transform of a session to the placed ones, or the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import numpy as np

from firstfix.engine.registration.surface import Surface
from firstfix.transform import Matrix, inverse

from .agreement import Agreement, Consensus, consensus_of
from .ask_places import AskedPlace, ask_places
from .check import SharedPlace, shared_places
from .join import Overlap, PlacedSurface
from .session_map import PlacedSession, SessionMap

MIN_AGREEING = 5  # places
MIN_AGREEING_SHARE = 0.4  # of the places that are in both sessions
MIN_VOTES = 5.0  # sum of probabilities
MIN_LEAD = 2.0  # ratio to the votes of any other transform
MIN_OVERLAP = 0.05
MAX_RESIDUAL_M = 0.08
MIN_SAME = 0.7  # median share of equal rays, over the places in both sessions
MIN_MOVABLE, MIN_MOVABLE_SAME = (
    0.03,
    0.35,
)  # share of rays to movable objects; of these, to objects of both sessions
MAX_OFFSET_M, MAX_OFFSET_DEG = 0.2, 1.5
MAX_OFF_SHARE = 0.1  # of the places that may be off by more
BENT_WITHIN_M = 6.0  # smaller errors of a localized place show a bent map, larger ones a wrong answer


def no_consensus(votes: Sequence[AskedPlace], found: Consensus | None) -> str | None:
    """Refuse a transform with which too few places agree, and one with a strong rival."""
    asked = len({tuple(place.position_m) for place in votes})
    if not asked:
        return "no place of it shows enough surface to be localized"
    votes_for = 0.0 if found is None else found.votes
    if found is None or len(found.agreeing) < MIN_AGREEING or votes_for < MIN_VOTES:
        return (
            f"too little overlap: {asked} places of it were searched for; those that agree on a transform "
            f"have {votes_for:.1f} votes, and {MIN_VOTES:.0f} votes of {MIN_AGREEING} places are needed"
        )
    if found.votes < MIN_LEAD * found.rival_votes:
        return (
            f"ambiguous: its places fit at two positions, with {found.votes:.1f} and {found.rival_votes:.1f} "
            "votes"
        )
    return None


def not_one_place(asked: Agreement, overlap: Overlap, shared: Sequence[SharedPlace]) -> str | None:
    """Refuse sessions with too little in common, and sessions of two places that look alike."""
    if overlap.share < MIN_OVERLAP or len(shared) < MIN_AGREEING:
        return (
            f"too little overlap: {overlap.share:.0%} of its surface lies on the others', and {len(shared)} "
            "places are in both"
        )
    if asked.agreeing_in_both < max(MIN_AGREEING, MIN_AGREEING_SHARE * asked.in_both):
        return (
            f"it may be another place that looks alike: of {asked.in_both} places where both have been, only "
            f"{asked.agreeing_in_both} were localized where they should be"
        )
    same = float(np.median([place.same for place in shared]))
    if same < MIN_SAME:
        return (
            f"it may be another place that looks alike: from places where both have been, only {same:.0%} of "
            "the view is the same"
        )
    movable, movable_same = movable_shares(shared)
    if movable >= MIN_MOVABLE and movable_same < MIN_MOVABLE_SAME:
        return (
            "it may be another place that looks alike, such as another storey: only "
            f"{movable_same:.0%} of the things in it are the same"
        )
    if overlap.residual_m > MAX_RESIDUAL_M:
        return f"after registration the surfaces lie {overlap.residual_m:.2f} m apart (median)"
    return None


def movable_shares(shared: Sequence[SharedPlace]) -> tuple[float, float]:
    """Share of rays that meet movable objects, and share of these that meet the same one in both sessions."""
    same, other = (sum(place.movable[which] for place in shared) for which in (0, 1))
    rays = sum(place.rays for place in shared)
    return (same + other) / max(rays, 1), same / max(same + other, 1)


def bent(asked: Agreement, shared: Sequence[SharedPlace]) -> str | None:
    """Refuse a session that no rigid transform aligns with the others."""
    off = [(*place.offset, place.position_m) for place in shared if place.offset is not None]
    astray = asked.astray_m < BENT_WITHIN_M
    off += [(float(m), 0.0, p) for m, p in zip(asked.astray_m[astray], asked.position_m[astray], strict=True)]
    worst = [one for one in off if one[0] > MAX_OFFSET_M or one[1] > MAX_OFFSET_DEG]
    if len(worst) <= MAX_OFF_SHARE * len(off):
        return None
    offset_m, offset_deg, at = max(worst, key=lambda one: one[0] / MAX_OFFSET_M + one[1] / MAX_OFFSET_DEG)
    x, y, z = at
    return (
        f"bent: no rigid transform fits all of it. {len(worst)} of {len(off)} places are off, most at "
        f"({x:.1f}, {y:.1f}, {z:.1f}) m by {offset_m:.2f} m and {offset_deg:.1f} degrees"
    )


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
    """Localize scans of the session in the placed ones, registers the clouds, and check the result.

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

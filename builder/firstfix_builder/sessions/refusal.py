"""Reasons to refuse a session, as text: each has the measured value and, where there is one, the limit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .agreement import Agreement
from .ask_places import AskedPlace
from .check import SharedPlace
from .consensus import Consensus
from .join import Overlap

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
    """Refuses a transform with which too few places agree, and one with a strong rival."""
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
    """Refuses sessions with too little in common, and sessions of two places that look alike."""
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
    """Refuses a session that no rigid transform aligns with the others."""
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

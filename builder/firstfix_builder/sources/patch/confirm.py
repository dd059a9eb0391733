"""Confirmed changes: what several robots saw over days, once, and nobody saw otherwise since.

The rule (docs/how-to/my-map.md has it in words). For each cell its sightings are sorted by time and cut
at the moment that explains most of them: unchanged before, changed after. A cell passes if both sides are
nearly of one mind, and if the side after it has enough places, robots and days. A part of the map that was
never mapped passes by the same rule: nobody may have seen it otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.changes.cells import box_of, cells_of_keys, keys_of
from firstfix.engine.changes.unmapped import groups_of, unmapped_of
from firstfix.engine.false_accept_bound import upper_bound

from .observation import Seen

DAY_S = 86400.0
CONFIDENCE = 0.95
SIDES = {"gone": ("contradicted", "confirmed"), "new": ("unexplained", "free")}  # for the change, against it


@dataclass(frozen=True)
class PatchRule:
    """Bars that a change must pass.

    Attributes:
        robots: distinct robots that saw it, each from ``robot_spots`` places of 1 m, on ``robot_days`` days.
        days: distinct days (UTC) on which it was seen.
        span_s: time between the first and the last sighting of it.
        share: of the votes since it happened that must agree. A vote is one robot at one place on one day.
        least_share: the lower 95 % bound of the share of places that agree is above this.
        most_before: share of the votes before it happened that may have seen it already, but one always may.
        cells: connected cells of 0.5 m that an area has at least.
        undisputed: of the connected cells that pass or about which robots disagree, the share that must pass.
            Of a thing that came back, some cells are met no more.
    """

    robots: int = 2
    robot_spots: int = 2
    robot_days: int = 2
    days: int = 3
    span_s: float = 2 * DAY_S
    share: float = 0.8
    least_share: float = 0.5
    most_before: float = 0.2
    cells: int = 3
    undisputed: float = 0.5


@dataclass(frozen=True)
class ChangedArea:
    """Cells of one kind.

    Attributes:
        kind: ``gone``, ``new`` or ``unmapped``, as ``firstfix.engine.changes.areas.Area`` has it.
        cells: (n, 3) numbers of its cells, in the map's frame.
    """

    kind: str
    cells: NDArray[np.int64]

    @property
    def box_m(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest corner, (3,) each, in the map's frame."""
        return box_of(self.cells)


@dataclass(frozen=True)
class Change:
    """A connected group of cells that have changed in the same way.

    Attributes:
        kind: ``gone``, or ``new`` for what the map does not explain.
        cells: (n, 3) numbers of its cells, in the map's frame.
        unmapped: (n,) those of a new one that the mapping run never saw.
        since_s: time of the first sighting of it, seconds since 1970.
        robots: pseudonyms of those that saw it.
        days: number of days on which it was seen.
    """

    kind: str
    cells: NDArray[np.int64]
    unmapped: NDArray[np.bool_]
    since_s: float
    robots: frozenset[str]
    days: int

    @property
    def areas(self) -> list[ChangedArea]:
        """Its cells by kind: what has changed, and what was never mapped."""
        parts = ((self.kind, self.cells[~self.unmapped]), ("unmapped", self.cells[self.unmapped]))
        return [ChangedArea(kind, cells) for kind, cells in parts if len(cells)]


@dataclass(frozen=True)
class _Votes:
    """Sightings of one cell, oldest first: (n,) each."""

    time_s: NDArray[np.float64]
    robot: NDArray[np.int64]
    spot: NDArray[np.int64]
    agrees: NDArray[np.bool_]

    def at(self, rows: slice) -> _Votes:
        return _Votes(self.time_s[rows], self.robot[rows], self.spot[rows], self.agrees[rows])

    @property
    def day(self) -> NDArray[np.int64]:
        return np.floor(self.time_s / DAY_S).astype(np.int64)

    def grouped(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """(v, 3) robot, spot and day of each vote, and (v,) the share of its sightings that agree."""
        who, row = np.unique(np.stack([self.robot, self.spot, self.day], axis=1), axis=0, return_inverse=True)
        row = row.ravel()
        return who, np.bincount(row, self.agrees) / np.bincount(row)


@dataclass(frozen=True)
class _Judged:
    """Judgement of one cell: it has changed, or, without a time, robots disagree."""

    since_s: float | None = None
    robots: frozenset[int] = frozenset()
    days: frozenset[int] = frozenset()


_DISPUTED = _Judged()


def confirmed_changes(seen: Sequence[Seen], rule: PatchRule | None = None) -> list[Change]:
    """The changes that pass the rule, the largest first.

    Args:
        seen: the oldest first.
    """
    rule = rule or PatchRule()
    names = sorted({one.observation.robot for one in seen})
    found: list[Change] = []
    for kind, (for_it, against) in SIDES.items():
        judged = _judged_cells(seen, names, for_it, against, rule)
        if not judged:
            continue
        keys = np.array(sorted(judged), np.int64)
        cells = cells_of_keys(keys)
        group = groups_of(cells)
        for number in range(int(group.max()) + 1):
            inside = np.flatnonzero(group == number)
            each = {row: judged[int(keys[row])] for row in inside.tolist()}
            since_s = {row: one.since_s for row, one in each.items() if one.since_s is not None}
            if len(since_s) < max(rule.cells, rule.undisputed * len(each)):
                continue
            changed = cells[sorted(since_s)]
            found.append(
                Change(
                    kind,
                    changed,
                    unmapped_of(changed, _unmapped_share(seen, keys_of(changed))),
                    min(since_s.values()),
                    frozenset(names[robot] for one in each.values() for robot in one.robots),
                    len(frozenset[int]().union(*(one.days for one in each.values()))),
                )
            )
    return sorted(found, key=lambda one: (-len(one.cells), one.kind, one.cells[0].tolist()))


def _judged_cells(
    seen: Sequence[Seen], names: Sequence[str], for_it: str, against: str, rule: PatchRule
) -> dict[int, _Judged]:
    """The cells that pass the rule, and those about which robots disagree, by key."""
    suspects = _suspects(seen, for_it, rule.robots)
    cell, row, agrees = [], [], []
    for number, one in enumerate(seen):
        for attribute, is_for in ((for_it, True), (against, False)):
            keys = getattr(one.sighting, attribute)
            keys = keys[np.isin(keys, suspects, assume_unique=True)]
            cell.append(keys)
            row.append(np.full(len(keys), number))
            agrees.append(np.full(len(keys), is_for))
    if not len(suspects):
        return {}
    keys, rows, yes = np.concatenate(cell), np.concatenate(row), np.concatenate(agrees)
    order = np.lexsort((rows, keys))
    keys, rows, yes = keys[order], rows[order], yes[order]
    robot = np.array([names.index(one.observation.robot) for one in seen])
    spot = np.unique([one.sighting.spot for one in seen], axis=0, return_inverse=True)[1].ravel()
    time_s = np.array([one.observation.time_s for one in seen])
    start = np.append(np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]]), len(keys))
    found = {}
    for a, b in zip(start[:-1].tolist(), start[1:].tolist(), strict=True):
        part = rows[a:b]
        judged = _judge(_Votes(time_s[part], robot[part], spot[part], yes[a:b]), rule)
        if judged is not None:
            found[int(keys[a])] = judged
    return found


def _unmapped_share(seen: Sequence[Seen], keys: NDArray[np.int64]) -> NDArray[np.float64]:
    """(n,) share of the sightings that did not explain a cell and say that it was never seen; 0 of none.

    Args:
        keys: (n,) of the cells, ascending.
    """
    unexplained, unmapped = np.zeros(len(keys)), np.zeros(len(keys))
    for one in seen:
        unexplained += np.isin(keys, one.sighting.unexplained)
        unmapped += np.isin(keys, one.sighting.unmapped)
    return unmapped / np.maximum(unexplained, 1)


def _suspects(seen: Sequence[Seen], for_it: str, robots: int) -> NDArray[np.int64]:
    """Keys of the cells for which enough robots speak, ascending: only these are looked at further."""
    by_robot: dict[str, list[NDArray[np.int64]]] = {}
    for one in seen:
        by_robot.setdefault(one.observation.robot, []).append(getattr(one.sighting, for_it))
    each = [np.unique(np.concatenate(parts)) for parts in by_robot.values()]
    if not each:
        return np.empty(0, np.int64)
    keys, count = np.unique(np.concatenate(each), return_counts=True)
    return keys[count >= robots]


def _judge(votes: _Votes, rule: PatchRule) -> _Judged | None:
    """Whether a cell has changed once and for all; None: too little was seen to say so."""
    after_is, before_is = votes.agrees, ~votes.agrees
    right = np.r_[0, np.cumsum(before_is)] + after_is.sum() - np.r_[0, np.cumsum(after_is)]
    cut = int(np.argmax(right))  # the first of the best: more speaks about the time after it
    if cut:
        early = votes.at(slice(0, cut)).grouped()[1]
        if early.sum() > max(1.0, rule.most_before * len(early)):
            return _DISPUTED
    after = votes.at(slice(cut, None))
    if not len(after.agrees):
        return None
    who, share = after.grouped()
    robots, days = _of_one_mind(who[:, 0], share), _of_one_mind(who[:, 2], share)
    if share.mean() < rule.share or robots is None or days is None:
        return _DISPUTED
    yes = who[share > 0.5]
    counted = frozenset(
        robot
        for robot in robots
        if len(np.unique(yes[yes[:, 0] == robot, 1])) >= rule.robot_spots
        and len(np.unique(yes[yes[:, 0] == robot, 2])) >= rule.robot_days
    )
    times = after.time_s[after.agrees & np.isin(after.robot, sorted(counted))]
    if (
        len(counted) < rule.robots
        or len(days) < rule.days
        or np.ptp(times) < rule.span_s
        or _least_share(who[:, 1], share) <= rule.least_share
    ):
        return None
    return _Judged(float(times.min()), counted, days)


def _least_share(spot: NDArray[np.int64], share: NDArray[np.float64]) -> float:
    """Lower bound of the share of places from which the change is seen."""
    row = np.unique(spot, return_inverse=True)[1].ravel()
    of_spot = np.bincount(row, share) / np.bincount(row)
    return 1 - upper_bound(len(of_spot) - int(np.floor(of_spot.sum() + 1e-9)), len(of_spot), CONFIDENCE)


def _of_one_mind(group: NDArray[np.int64], share: NDArray[np.float64]) -> frozenset[int] | None:
    """The robots, or days, most of whose votes agree; None: one with two votes or more does not."""
    names, row = np.unique(group, return_inverse=True)
    count = np.bincount(row.ravel())
    mean = np.bincount(row.ravel(), share) / count
    if ((mean < 0.5) & (count >= 2)).any():
        return None
    return frozenset(names[mean > 0.5].tolist())

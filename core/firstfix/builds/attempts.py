"""Who runs a build, for how long it is theirs, and how often that went wrong.

    builds/<build_id>/attempts/000001.json       created once: whoever creates it has the build
    builds/<build_id>/attempts/000001.beat       replaced by its holder: still there
    builds/<build_id>/attempts/000001.look       replaced by whoever else wants the build
    builds/<build_id>/attempts/000001.end.json   created once: how it ended, as its holder says, or
                                                 somebody who found its beat too old

Attempt n + 1 is created only when n has ended: of many who want a build one gets it. The age of a beat is
its ``last_modified`` against that of a look put just now: both times are the store's, so no two clocks
are compared. A clock that is set forward under a holder, or a holder that was frozen and comes back, can
let two run the same build for a while; that costs work and nothing else, as everything that a build
publishes is created once and named by its content.
"""

from __future__ import annotations

import json
import math
import re
import uuid
from collections import Counter
from dataclasses import dataclass
from datetime import datetime, timezone
from enum import Enum
from typing import Any

from ..errors import BuildAttemptsExceeded, NotFound, UnreadableRecord
from ..ids import check_build_id
from ..store.json_record import RecordKind, read_record, text_of
from ..store.store import Store

_NAME = re.compile(r"(\d{6,})\.(json|beat|look|end\.json)")
_MAX_REASON_CHARS = 300  # of the last death, in the error


class AttemptEnd(str, Enum):
    """How an attempt ended: ``died`` and ``lost`` count against the build, the others do not."""

    ENDED = "ended"  # the build reached a final state
    STOPPED = "stopped"  # in good order: a deployment, or a store out of reach
    DIED = "died"  # its process was killed
    LOST = "lost"  # its holder fell silent


@dataclass(frozen=True)
class Attempt:
    """One holder's turn at a build.

    Attributes:
        number: 1, 2, ...
    """

    build_id: str
    number: int


class BuildAttempts:
    """Attempts as one holder makes them. Thread-safe. Every method raises StoreUnavailable or StoreError
    as the store does.

    Args:
        claimant: unique to whoever may run one build at a time; an open attempt of the same claimant is one
            that it did not live to end.
        lease_s: an attempt without a beat for so long is over.
        max_attempts: that may die or be lost in one and the same stage of a build. One that got further
            before it died may have been killed by anything, and is not held against the build.
    """

    def __init__(self, store: Store, claimant: str, *, lease_s: float, max_attempts: int) -> None:
        self._store = store
        self._claimant = claimant
        self._lease_s = lease_s
        self._max_attempts = max_attempts

    def claim(self, build_id: str, stage: str) -> Attempt | None:
        """A new attempt; None while somebody else has the build.

        Args:
            stage: that the build is in by its status: where an attempt was lost.

        Raises:
            BuildAttemptsExceeded: it has had its attempts.
        """
        found = _scan(self._store, build_id)
        last = max(found, default=0)
        if last and "end.json" not in found[last]:
            why = self._gone(build_id, last)
            if why is None:
                return None
            self.end(Attempt(build_id, last), AttemptEnd.LOST, stage=stage, why=why)
        self._check_failures(build_id, last)
        content = {"holder": self._claimant, "time": _now(), "writer": uuid.uuid4().hex}
        if not self._create(f"{_folder(build_id)}/{last + 1:06d}.json", content):
            return None
        attempt = Attempt(build_id, last + 1)
        self.beat(attempt)
        return attempt

    def beat(self, attempt: Attempt) -> bool:
        """Says that the holder is there. False when somebody has ended the attempt: to be dropped at once."""
        key = _key(attempt)
        if self._store.exists(f"{key}.end.json"):
            return False
        self._store.put(f"{key}.beat", uuid.uuid4().bytes)
        return True

    def end(
        self, attempt: Attempt, how: AttemptEnd, *, stage: str = "", why: str = "", ran_s: float = 0.0
    ) -> None:
        """Says how it ended; of several who say it the first is right.

        Args:
            ran_s: for how long its process ran; of a lost attempt nobody knows.
        """
        key = _key(attempt)
        record = {
            "end": how.value,
            "stage": stage,
            "why": why[:1000],
            "time": _now(),
            "ran_s": round(ran_s, 3),
        }
        self._create(f"{key}.end.json", record)
        for name in ("beat", "look"):
            self._store.delete(f"{key}.{name}")

    def ran_s(self, build_id: str) -> float:
        """For how long the attempts that have ended ran, together."""
        total_s = 0.0
        for number, kinds in _scan(self._store, build_id).items():
            if "end.json" in kinds:
                ran_s = _read(self._store, f"{_folder(build_id)}/{number:06d}.end.json").get("ran_s")
                if isinstance(ran_s, int | float) and math.isfinite(ran_s):
                    total_s += max(ran_s, 0.0)
        return total_s

    def _gone(self, build_id: str, number: int) -> str | None:
        """Why the holder of an open attempt is taken for dead; None when it is not."""
        key = f"{_folder(build_id)}/{number:06d}"
        if self._is_own(f"{key}.json"):
            return "the process that ran the build's worker ended"
        self._store.put(f"{key}.look", uuid.uuid4().bytes)
        seen = {
            item.key: item.last_modified.timestamp()
            for item in self._store.scan(_folder(build_id))
            if item.key.startswith(f"{key}.")
        }
        look_s = seen.get(f"{key}.look")
        if look_s is None or f"{key}.end.json" in seen:  # it ended this moment: look again later
            return None
        beat_s = seen.get(f"{key}.beat", seen[f"{key}.json"])
        if look_s - beat_s <= self._lease_s:
            return None
        return f"its worker was not heard of for {look_s - beat_s:.0f} s"

    def _is_own(self, key: str) -> bool:
        """Whether this holder made the attempt. Of one that cannot be read its beat says how it stands."""
        try:
            return _read(self._store, key)["holder"] == self._claimant
        except UnreadableRecord:
            return False

    def _check_failures(self, build_id: str, last: int) -> None:
        died: Counter[str] = Counter()
        for number in range(1, last + 1):
            try:
                ended = _read(self._store, f"{_folder(build_id)}/{number:06d}.end.json")
            except (NotFound, UnreadableRecord):  # it has ended; how, nobody can tell
                continue
            if ended.get("end") in (AttemptEnd.DIED, AttemptEnd.LOST):
                stage, why = str(ended.get("stage", "")), str(ended.get("why", ""))
                died[stage] += 1
                if died[stage] >= self._max_attempts:
                    where = f"in the stage {stage}" if stage else "before the first stage"
                    raise BuildAttemptsExceeded(
                        f"{died[stage]} attempts died {where}; the last one: {why[:_MAX_REASON_CHARS]}"
                    )

    def _create(self, key: str, record: dict[str, Any]) -> bool:
        data = json.dumps(record, sort_keys=True).encode()
        # A lost reply makes a retry meet its own object.
        return self._store.put_new(key, data) or self._store.get(key) == data


def has_open_attempt(store: Store, build_id: str) -> bool:
    """Whether somebody runs the build, or did not live to say that it ended."""
    found = _scan(store, build_id)
    return bool(found) and "end.json" not in found[max(found)]


def _scan(store: Store, build_id: str) -> dict[int, set[str]]:
    """The attempts on record: number to what there is of it."""
    found: dict[int, set[str]] = {}
    for key in store.list(_folder(build_id)):
        match = _NAME.fullmatch(key.rsplit("/", 1)[-1])
        if match is not None:
            found.setdefault(int(match[1]), set()).add(match[2])
    # A beat or a look that came after the end was recorded is nothing by itself.
    return {number: kinds for number, kinds in found.items() if "json" in kinds}


def parse_attempt(record: dict[str, Any]) -> dict[str, Any]:
    """
    Raises:
        ValueError, TypeError, KeyError: neither an attempt nor the end of one.
    """
    text_of(record, "end" if "end" in record else "holder")
    for name in ("stage", "why", "time"):
        text_of(record, name, "")
    return record


def _read(store: Store, key: str) -> dict[str, Any]:
    return read_record(store, key, RecordKind.BUILD_ATTEMPT, parse_attempt)


def _folder(build_id: str) -> str:
    return f"builds/{check_build_id(build_id)}/attempts"


def _key(attempt: Attempt) -> str:
    return f"{_folder(attempt.build_id)}/{attempt.number:06d}"


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")

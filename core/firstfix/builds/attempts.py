"""Attempts at a build: leases, which claimants keep alive by heartbeats, and a count of failures.

    builds/<build_id>/attempts/000001.json       created once: its creator, the claimant, runs the build
    builds/<build_id>/attempts/000001.beat       heartbeat, replaced by the claimant
    builds/<build_id>/attempts/000001.look       replaced by other processes that want the build
    builds/<build_id>/attempts/000001.end.json   created once: how the attempt ended, written by the claimant,
                                                 or by a process that found the heartbeat too old

Attempt n + 1 is created only after n has ended: of many processes that want a build, one gets it. The age of
a heartbeat is the difference between its ``last_modified`` and that of a look put just now. Both times are
the store's, so no two clocks are compared. If the store's clock jumps forward, or a frozen claimant
continues, two processes can run the same build for a while. This only costs work, because everything that a
build publishes is created once and named by its content.
"""

from __future__ import annotations

import math
import re
import uuid
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timezone
from enum import Enum
from typing import Any

from ..errors import BuildAttemptsExceeded, NotFound, UnreadableRecord
from ..ids import check_build_id
from ..store.json_record import RecordKind, read_record, record_json, text_of
from ..store.store import Store

_NAME = re.compile(r"(\d{6,})\.(json|beat|look|end\.json)")
_MAX_REASON_CHARS = 300  # of the last failure, in the error
# Lost attempts for each failure that a build may have: its machine or its service was restarted, killed or
# drained, most likely for another reason. But a build that takes its machine down each time must end.
LOST_PER_FAILURE = 10


class AttemptEnd(str, Enum):
    """End of an attempt.

    ``died`` counts as a failure of the build. ``lost`` does too, but ``LOST_PER_FAILURE`` of them are allowed
    for each failure. The others do not count.
    """

    ENDED = "ended"  # the build reached a final state
    STOPPED = "stopped"  # a deployment, the store is out of reach, or its process saw that its parent ended
    NO_SPACE = "no_space"  # the store or the work folder was full
    DIED = "died"  # its process was killed
    LOST = "lost"  # its heartbeat stopped, and its process said nothing


@dataclass(frozen=True)
class Attempt:
    """Lease of a build.

    Attributes:
        number: 1, 2, ...
    """

    build_id: str
    number: int


class BuildAttempts:
    """Attempts of one claimant at builds. Thread-safe.

    Every method raises StoreUnavailable or StoreError if the store fails.

    Args:
        claimant: unique name of a process that runs one build at a time. An open attempt of the same name is
            left from a claimant that was killed.
        lease_s: an attempt without a heartbeat for this long is lost.
        max_attempts: number of failures without progress after which a build fails. The count begins again
            when an attempt gets further than all before it: its inputs are not the likely cause then.
    """

    def __init__(self, store: Store, claimant: str, *, lease_s: float, max_attempts: int) -> None:
        self._store = store
        self._claimant = claimant
        self._lease_s = lease_s
        self._max_attempts = max_attempts

    def claim(self, build_id: str, status: Mapping[str, Any]) -> Attempt | None:
        """Begin a new attempt. Returns None while another claimant runs the build.

        Args:
            status: of the build: where a lost attempt was. A process that sees its parent end sets the state
                to queued. If the state is still running, the process was killed first or together with it.

        Raises:
            BuildAttemptsExceeded: too many attempts have failed.
        """
        found = _scan(self._store, build_id)
        last = max(found, default=0)
        if last and "end.json" not in found[last]:
            why = self._why_lost(build_id, last)
            if why is None:
                return None
            how = AttemptEnd.LOST if status["state"] == "running" else AttemptEnd.STOPPED
            self.end(Attempt(build_id, last), how, status=status, why=why)
        self._check_failures(build_id)
        content = {"holder": self._claimant, "time": _now(), "writer": uuid.uuid4().hex}
        if not self._create(f"{_folder(build_id)}/{last + 1:06d}.json", content):
            return None
        attempt = Attempt(build_id, last + 1)
        self.beat(attempt)
        return attempt

    def beat(self, attempt: Attempt) -> bool:
        """Put a heartbeat. Returns False if the attempt was ended by others: then stop the build at once."""
        key = _key(attempt)
        if self._store.exists(f"{key}.end.json"):
            return False
        self._store.put(f"{key}.beat", uuid.uuid4().bytes)
        return True

    def end(
        self,
        attempt: Attempt,
        how: AttemptEnd,
        *,
        status: Mapping[str, Any] | None = None,
        why: str = "",
        ran_s: float = 0.0,
    ) -> None:
        """Record the end of an attempt. If several processes do, the first counts.

        Args:
            status: of the build at the end, for a failure.
            ran_s: run time of its process; unknown for a lost attempt.
        """
        key = _key(attempt)
        at = status or {"stage": "", "progress": 0.0}
        record = {
            "end": how.value,
            "stage": at["stage"],
            "progress": at["progress"],
            "why": why[:1000],
            "time": _now(),
            "ran_s": round(ran_s, 3),
        }
        self._create(f"{key}.end.json", record)
        for name in ("beat", "look"):
            self._store.delete(f"{key}.{name}")

    def ran_s(self, build_id: str) -> float:
        """Total run time of the ended attempts at a build."""
        return sum(max(_number(ended, "ran_s"), 0.0) for ended in self._ends(build_id))

    def times_without_space(self, build_id: str) -> int:
        """Number of the last attempts that ended, one after the other, because there was no space."""
        count = 0
        for ended in self._ends(build_id):
            count = count + 1 if ended.get("end") == AttemptEnd.NO_SPACE else 0
        return count

    def _why_lost(self, build_id: str, number: int) -> str | None:
        """Reason to take an open attempt for lost, or None."""
        key = f"{_folder(build_id)}/{number:06d}"
        if self._is_own(f"{key}.json"):
            return "the process that ran the build worker ended"
        self._store.put(f"{key}.look", uuid.uuid4().bytes)
        seen = {
            item.key: item.last_modified.timestamp()
            for item in self._store.scan(_folder(build_id))
            if item.key.startswith(f"{key}.")
        }
        look_s = seen.get(f"{key}.look")
        if look_s is None or f"{key}.end.json" in seen:  # it has just ended: look again later
            return None
        beat_s = seen.get(f"{key}.beat", seen[f"{key}.json"])
        if look_s - beat_s <= self._lease_s:
            return None
        return f"its build worker sent no heartbeat for {look_s - beat_s:.0f} s"

    def _is_own(self, key: str) -> bool:
        """Whether this claimant made the attempt. False if its record is damaged."""
        try:
            return _read(self._store, key)["holder"] == self._claimant
        except UnreadableRecord:
            return False

    def _check_failures(self, build_id: str) -> None:
        failures: Counter[Any] = Counter()
        furthest = 0.0
        for ended in self._ends(build_id):
            how = ended.get("end")
            if how not in (AttemptEnd.DIED, AttemptEnd.LOST):
                continue
            if (progress := _number(ended, "progress")) > furthest:
                furthest = progress
                failures.clear()
            failures[how] += 1
            allowed = self._max_attempts * (LOST_PER_FAILURE if how == AttemptEnd.LOST else 1)
            if failures[how] >= allowed:
                stage, why = str(ended.get("stage", "")), str(ended.get("why", ""))
                where = f"in the stage {stage}" if stage else "before the first stage"
                raise BuildAttemptsExceeded(
                    f"{failures[how]} attempts failed without progress; the last one {where}: "
                    f"{why[:_MAX_REASON_CHARS]}"
                )

    def _ends(self, build_id: str) -> Iterator[dict[str, Any]]:
        """Records of the ends of a build's attempts, in order. Damaged ones are left out."""
        for number, kinds in sorted(_scan(self._store, build_id).items()):
            if "end.json" in kinds:
                with suppress(NotFound, UnreadableRecord):  # ended, but nobody can tell how
                    yield _read(self._store, f"{_folder(build_id)}/{number:06d}.end.json")

    def _create(self, key: str, record: dict[str, Any]) -> bool:
        data = record_json(record)
        # After a lost reply the retry meets its own object.
        return self._store.put_new(key, data) or self._store.get(key) == data


def has_open_attempt(store: Store, build_id: str) -> bool:
    """Whether the last attempt at a build is open: it is running, or its claimant was killed."""
    found = _scan(store, build_id)
    return bool(found) and "end.json" not in found[max(found)]


def _scan(store: Store, build_id: str) -> dict[int, set[str]]:
    """Attempts on record: number to the kinds of its objects."""
    found: dict[int, set[str]] = {}
    for key in store.list(_folder(build_id)):
        match = _NAME.fullmatch(key.rsplit("/", 1)[-1])
        if match is not None:
            found.setdefault(int(match[1]), set()).add(match[2])
    # A heartbeat or look put after the end was recorded means nothing by itself.
    return {number: kinds for number, kinds in found.items() if "json" in kinds}


def parse_attempt(record: dict[str, Any]) -> dict[str, Any]:
    """Parse the record of an attempt, or of its end.

    Raises:
        ValueError, TypeError, KeyError: it is neither.
    """
    text_of(record, "end" if "end" in record else "holder")
    for name in ("stage", "why", "time"):
        text_of(record, name, "")
    return record


def _read(store: Store, key: str) -> dict[str, Any]:
    return read_record(store, key, RecordKind.BUILD_ATTEMPT, parse_attempt)


def _number(record: Mapping[str, Any], name: str) -> float:
    """A number of a record; 0 if it is missing or not finite."""
    value = record.get(name)
    return float(value) if isinstance(value, int | float) and math.isfinite(value) else 0.0


def _folder(build_id: str) -> str:
    return f"builds/{check_build_id(build_id)}/attempts"


def _key(attempt: Attempt) -> str:
    return f"{_folder(attempt.build_id)}/{attempt.number:06d}"


def _now() -> str:
    return datetime.now(timezone.utc).isoformat(timespec="seconds")

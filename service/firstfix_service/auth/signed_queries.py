"""Queries that were signed with an API key: who signed, whether in time, and whether for the first time."""

from __future__ import annotations

import time
from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

from firstfix.errors import ClockSkew, RateLimited, Unauthorized
from firstfix.wire.signature import WINDOW_S, Asked, QuerySignature, SigningKey

from .key_ring import KeyRing
from .principal import Principal

# Of one key, within the time that they are remembered: more than 200 queries a second of one robot.
MAX_NONCES_PER_KEY = 30_000
SET_BACK_S = 1.0  # a wall clock that falls behind by more was set back, and makes old queries look new
# A query may be dated a window ahead, and is accepted until a window later by a clock that was not set back.
REMEMBERED_S = 2 * WINDOW_S + SET_BACK_S


@dataclass(frozen=True)
class SignedQuery:
    """A query whose signature is right. ``SignedQueries.accept`` says whether it may be answered."""

    principal: Principal
    key: SigningKey
    signature: QuerySignature


class SignedQueries:
    """Checks signatures. ``accept`` is for use by one event loop; ``check`` is thread-safe.

    Args:
        wall_clock: seconds since 1970, by which robots date their queries. It may be set at any time.
        clock: monotonic time in seconds, by which all ages are measured.
    """

    def __init__(
        self,
        keys: KeyRing,
        wall_clock: Callable[[], float] = time.time,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._keys = keys
        self._wall_clock, self._clock = wall_clock, clock
        # What was accepted before this moment may be forgotten: at the start all of it is.
        self._remembers_since_s = clock()
        self._ahead_s = self._wall_ahead_s  # at most, since then
        self._seen: OrderedDict[tuple[str, bytes], float] = OrderedDict()  # (key id, nonce) -> when it came
        self._of_key: Counter[str] = Counter()

    def check(self, attachment: bytes, asked: Asked) -> SignedQuery:
        """The query with its signer. Changes nothing, and does not read the payload.

        Raises:
            Unauthorized, StoreUnavailable: as ``KeyRing.signer``; or the attachment has another form.
        """
        signature = QuerySignature.parse(attachment)
        if signature is None:
            raise Unauthorized("the signature of the query has not the form that this service knows")
        principal, key = self._keys.signer(signature, asked)
        return SignedQuery(principal, key, signature)

    def accept(self, query: SignedQuery) -> bool:
        """Accept a query once. Returns False if it was accepted before: this one may be a stranger's copy.

        Raises:
            ClockSkew: it was made too long ago or will be made later, by the service's clock.
            RateLimited: the key has asked too often to remember it.
        """
        now_ms, now_s, signature = int(self._wall_clock() * 1000), self._clock(), query.signature
        self._notice_set_back(now_s)
        apart_ms = signature.time_ms - now_ms
        remembered_ms = (now_s - self._remembers_since_s) * 1000 + 1  # dates are whole milliseconds
        if abs(apart_ms) > WINDOW_S * 1000 or apart_ms < -remembered_ms:
            raise ClockSkew(
                f"the query is dated {apart_ms / 1000:+.3f} s from the service's clock, over {WINDOW_S} s or "
                "before its start or the last time that it was set back",
                now_ms,
            )
        self._forget(now_s)
        seen = signature.key_id, signature.nonce
        if seen in self._seen:
            return False
        if self._of_key[signature.key_id] >= MAX_NONCES_PER_KEY:
            raise RateLimited(f"over {MAX_NONCES_PER_KEY} queries in {REMEMBERED_S} s", WINDOW_S)
        self._seen[seen] = now_s
        self._of_key[signature.key_id] += 1
        return True

    @property
    def _wall_ahead_s(self) -> float:
        return self._wall_clock() - self._clock()

    def _notice_set_back(self, now_s: float) -> None:
        ahead_s = self._wall_ahead_s
        if ahead_s < self._ahead_s - SET_BACK_S:
            self._remembers_since_s, self._ahead_s = now_s, ahead_s
        self._ahead_s = max(self._ahead_s, ahead_s)

    def _forget(self, now_s: float) -> None:
        while self._seen:
            seen, came_s = next(iter(self._seen.items()))
            if now_s - came_s <= REMEMBERED_S:
                break
            del self._seen[seen]
            self._of_key[seen[0]] -= 1
            if not self._of_key[seen[0]]:
                del self._of_key[seen[0]]

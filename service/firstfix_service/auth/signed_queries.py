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
REMEMBERED_S = 2 * WINDOW_S  # a query may be dated a window ahead, and is accepted until a window later


@dataclass(frozen=True)
class SignedQuery:
    """A query whose signature is right. ``SignedQueries.accept`` says whether it may be answered."""

    principal: Principal
    key: SigningKey
    signature: QuerySignature


class SignedQueries:
    """Checks signatures. ``accept`` is for use by one event loop; ``check`` is thread-safe.

    Args:
        clock: seconds since 1970.
    """

    def __init__(self, keys: KeyRing, clock: Callable[[], float] = time.time) -> None:
        self._keys = keys
        self._clock = clock
        # Nonces are forgotten at the end of the process, so queries from before its start are not accepted.
        self._since_ms = self._now_ms
        self._seen: OrderedDict[tuple[str, bytes], int] = OrderedDict()  # (key id, nonce) -> when it came
        self._of_key: Counter[str] = Counter()

    def check(self, attachment: bytes, asked: Asked) -> SignedQuery:
        """Returns the query with its signer. Changes nothing, and does not read the payload.

        Raises:
            Unauthorized, StoreUnavailable: as ``KeyRing.signer``; or the attachment has another form.
        """
        signature = QuerySignature.parse(attachment)
        if signature is None:
            raise Unauthorized("the signature of the query has not the form that this service knows")
        principal, key = self._keys.signer(signature, asked)
        return SignedQuery(principal, key, signature)

    def accept(self, query: SignedQuery) -> bool:
        """Accepts a query once. Returns False if it was accepted before: this one may be a stranger's copy.

        Raises:
            ClockSkew: it was made too long ago or will be made later, by the service's clock.
            RateLimited: the key has asked too often to remember it.
        """
        now_ms, signature = self._now_ms, query.signature
        apart_ms = signature.time_ms - now_ms
        if abs(apart_ms) > WINDOW_S * 1000 or signature.time_ms < self._since_ms:
            raise ClockSkew(
                f"the query is dated {apart_ms / 1000:+.3f} s from the service's clock, over {WINDOW_S} s or "
                "before the service's start",
                now_ms,
            )
        self._forget(now_ms)
        seen = signature.key_id, signature.nonce
        if seen in self._seen:
            return False
        if self._of_key[signature.key_id] >= MAX_NONCES_PER_KEY:
            raise RateLimited(f"over {MAX_NONCES_PER_KEY} queries in {REMEMBERED_S} s", WINDOW_S)
        self._seen[seen] = now_ms
        self._of_key[signature.key_id] += 1
        return True

    @property
    def _now_ms(self) -> int:
        return int(self._clock() * 1000)

    def _forget(self, now_ms: int) -> None:
        while self._seen:
            seen, came_ms = next(iter(self._seen.items()))
            if now_ms - came_ms <= REMEMBERED_S * 1000:
                break
            del self._seen[seen]
            self._of_key[seen[0]] -= 1
            if not self._of_key[seen[0]]:
                del self._of_key[seen[0]]

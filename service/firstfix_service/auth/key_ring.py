"""The API keys of the store, in memory: a request never waits for the store."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import datetime, timezone

import structlog

from firstfix.access.api_keys import ApiKey, ApiKeys, parse_token
from firstfix.errors import StoreError, StoreUnavailable, Unauthorized

from .principal import Caller

_log = structlog.get_logger(__name__)


class KeyRing:
    """The keys as of the last look. Thread-safe.

    Args:
        max_age_s: after so long without a look that succeeded they are worth nothing: one of them may have
            been revoked.
        clock: seconds, monotonic.
    """

    def __init__(self, keys: ApiKeys, max_age_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._keys = keys
        self._max_age_s = max_age_s
        self._clock = clock
        self._known: dict[str, ApiKey] = {}
        self._read_at: float | None = None
        self._bad: set[str] = set()

    @property
    def age_s(self) -> float:
        """Seconds since the last look that succeeded; infinite: there was none."""
        return float("inf") if self._read_at is None else self._clock() - self._read_at

    def refresh(self) -> None:
        """Looks into the store. When that fails the keys stay as they are."""
        started = self._clock()
        try:
            found, bad = self._keys.all()
        except StoreError as error:
            _log.warning("cannot read the API keys", code=error.code, error=str(error))
            return
        for key_id in set(bad) - self._bad:
            _log.error("the record of an API key cannot be read: it lets nobody in", key_id=key_id)
        self._bad = set(bad)
        self._known = {key.key_id: key for key in found if not key.revoked}
        self._read_at = started

    def caller(self, token: str) -> Caller:
        """Whose key it is.

        Raises:
            Unauthorized: nobody's, or it has expired.
            StoreUnavailable: the keys could not be read for too long.
        """
        parsed = parse_token(token)
        if parsed is None:
            raise Unauthorized("the credential does not have the form of an API key")
        if self.age_s > self._max_age_s:
            raise StoreUnavailable("the API keys cannot be read")
        key_id, secret = parsed
        key = self._known.get(key_id)  # ids are no secrets: that one is looked up faster tells nothing
        if key is None or not key.matches(secret):
            raise Unauthorized("no such API key, or it was revoked")
        if key.is_expired(datetime.now(timezone.utc)):
            raise Unauthorized(f"API key {key_id} has expired")
        return Caller(f"key:{key_id}", key.grant)

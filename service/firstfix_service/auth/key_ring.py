"""The API keys of the store, in memory, so that no request waits for the store."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import datetime, timezone

import structlog

from firstfix.access.api_keys import ApiKey, ApiKeys, parse_token
from firstfix.errors import StoreError, StoreUnavailable, Unauthorized

from .principal import Principal

_log = structlog.get_logger(__name__)


class KeyRing:
    """The API keys as of the last refresh. Thread-safe.

    Args:
        max_age_s: the keys are not accepted if no refresh has succeeded for so long, because one of them may
            have been revoked.
        clock: monotonic time in seconds.
    """

    def __init__(self, keys: ApiKeys, max_age_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._keys = keys
        self._max_age_s = max_age_s
        self._clock = clock
        self._known: dict[str, ApiKey] = {}
        self._read_at: float | None = None
        self._damaged: set[str] = set()

    @property
    def age_s(self) -> float:
        """Seconds since the last refresh that succeeded; infinite before the first one."""
        return float("inf") if self._read_at is None else self._clock() - self._read_at

    def refresh(self) -> None:
        """Reads the keys from the store. If that fails, the keys in memory stay."""
        started = self._clock()
        try:
            found, damaged = self._keys.all()
        except StoreError as error:
            _log.warning("cannot read the API keys", code=error.code, error=str(error))
            return
        for key_id in set(damaged) - self._damaged:
            _log.error("the record of an API key is damaged: the key is not accepted", key_id=key_id)
        self._damaged = set(damaged)
        self._known = {key.key_id: key for key in found if not key.revoked}
        self._read_at = started

    def principal(self, token: str) -> Principal:
        """Returns the caller whose API key this is.

        Raises:
            Unauthorized: there is no such key, or it has expired.
            StoreUnavailable: the keys could not be read for ``max_age_s``.
        """
        parsed = parse_token(token)
        if parsed is None:
            raise Unauthorized("the credential does not have the form of an API key")
        if self.age_s > self._max_age_s:
            raise StoreUnavailable("the API keys cannot be read")
        key_id, secret = parsed
        key = self._known.get(key_id)  # ids are not secret: the time of this look-up reveals nothing
        if key is None or not key.matches(secret):
            raise Unauthorized("no such API key, or it was revoked")
        if key.is_expired(datetime.now(timezone.utc)):
            raise Unauthorized(f"API key {key_id} has expired")
        return Principal(f"key:{key_id}", key.grant)

"""The API keys of the store, as they were read last."""

from __future__ import annotations

import time
from collections.abc import Callable
from datetime import datetime, timezone

import structlog

from firstfix.access.api_keys import ApiKey, ApiKeys, parse_token
from firstfix.errors import StoreError, StoreUnavailable, Unauthorized
from firstfix.wire.signature import Asked, QuerySignature, SigningKey

from .principal import Principal

_log = structlog.get_logger(__name__)
NO_SUCH_KEY = "no such API key, or it was revoked"


class KeyRing:
    """The API keys as of the last refresh. Thread-safe.

    Args:
        max_age_s: the keys are not accepted if no refresh has succeeded for so long, because one of them may
            have been revoked.
        clock: monotonic time in seconds.

    Attributes:
        listing: number of refreshes that succeeded.
    """

    def __init__(self, keys: ApiKeys, max_age_s: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._keys = keys
        self._max_age_s = max_age_s
        self._clock = clock
        self._known: dict[str, ApiKey] = {}
        self._read_at: float | None = None
        self._damaged: set[str] = set()
        self.listing = 0

    @property
    def age_s(self) -> float:
        """Seconds since the last refresh that succeeded; infinite before the first one."""
        return float("inf") if self._read_at is None else self._clock() - self._read_at

    def refresh(self) -> None:
        """Read the keys from the store. If that fails, the keys in memory stay."""
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
        self.listing += 1

    def knows(self, key_id: str) -> bool:
        """Whether a key is known; it may have expired."""
        return key_id in self._known

    def learn(self, key_id: str) -> None:
        """Read one key from the store. If that fails, it stays unknown."""
        try:
            key = self._keys.find(key_id)
        except StoreError as error:
            _log.warning("cannot look up an API key", code=error.code, error=str(error))
            return
        if key is not None:
            self._known = {**self._known, key_id: key}

    def principal(self, token: str) -> Principal:
        """The caller whose API key this is.

        Raises:
            Unauthorized: there is no such key, or it has expired.
            StoreUnavailable: the keys could not be read for ``max_age_s``.
        """
        parsed = parse_token(token)
        if parsed is None:
            raise Unauthorized("the credential does not have the form of an API key")
        key_id, secret = parsed
        key = self._key(key_id)
        if not key.matches(secret):
            raise Unauthorized(NO_SUCH_KEY)
        return principal_of(key)

    def signer(self, signature: QuerySignature, asked: Asked) -> tuple[Principal, SigningKey]:
        """The caller who signed a query, and the keys of its signatures.

        Raises:
            Unauthorized: there is no such key, it has expired, or the signature is wrong.
            StoreUnavailable: the keys could not be read for ``max_age_s``.
        """
        key = self._key(signature.key_id)
        try:
            signing = SigningKey.of_hash(key.key_id, bytes.fromhex(key.sha256))
        except ValueError:  # a record whose hash is none: the key is not accepted over HTTP either
            raise Unauthorized(NO_SUCH_KEY) from None
        if not signing.has_signed(signature, asked):
            raise Unauthorized("the signature does not fit the query")
        return principal_of(key), signing

    def _key(self, key_id: str) -> ApiKey:
        if self.age_s > self._max_age_s:
            raise StoreUnavailable("the API keys cannot be read")
        key = self._known.get(key_id)  # ids are not secret: the time of this look-up reveals nothing
        if key is None:
            raise Unauthorized(NO_SUCH_KEY)
        return key


def principal_of(key: ApiKey) -> Principal:
    """The caller who has a key.

    Raises:
        Unauthorized: the key has expired.
    """
    if key.is_expired(datetime.now(timezone.utc)):
        raise Unauthorized(f"API key {key.key_id} has expired")
    return Principal(f"key:{key.key_id}", key.grant, key.name)

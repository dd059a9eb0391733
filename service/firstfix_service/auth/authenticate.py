"""Authentication of callers for both transports: API keys, permissions, and rate limits."""

from __future__ import annotations

import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import TYPE_CHECKING

import structlog

from firstfix.access.api_keys import ApiKey, ApiKeys, parse_token
from firstfix.access.permissions import Scope
from firstfix.errors import RateLimited, StoreError, StoreUnavailable, Unauthorized
from firstfix.store.store import Store
from firstfix.wire.signature import Asked, QuerySignature, SigningKey

from ..security_check import exposed_at
from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import note
from ..thread_pools import KEYS
from ..thread_pools.background import PeriodicTask
from .principal import Needs, Principal

if TYPE_CHECKING:
    from .token_verifier import TokenVerifier

_log = structlog.get_logger(__name__)
_API_KEY = "ffx_"
NO_SUCH_KEY = "no such API key, or it was revoked"
CHECK_S = 1.0  # between two checks of a permission: they read memory, and verify the signature of a token
MAX_CALLERS = 10_000  # buckets in memory; the least recently used one is dropped, and is full again later
# For one caller of an exposed service
DEFAULT_LOCALIZE_PER_S, DEFAULT_BUILD_MINUTES_PER_DAY = 50.0, 1440.0
BUILDS_PER_HOUR = 60.0  # or more, if a caller may have so many minutes that each build could take one
CHANGES_PER_MIN = 60.0  # of each map: each change stays in its log for ever
AUTH_FAILURES_PER_MIN = 60.0  # of an address: nobody guesses 256 bits, but each guess is a line in the log
# A revoked key goes on working until the next listing of the keys, or while the store is away.
KEYS_REFRESH_S, KEYS_MAX_AGE_S = 5.0, 3600.0
_LOCALIZE_BURST_S = 5.0


class RateLimit:
    """A token bucket for each caller. For use by one event loop.

    Args:
        what: the counted requests, in the plural, for the error message.
        per_s: tokens that are added to each bucket per second.
        burst: tokens in a full bucket, at least 1.
        clock: monotonic time in seconds.
    """

    def __init__(
        self, what: str, per_s: float, burst: float, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._what = what
        self._per_s = per_s
        self._burst = max(1.0, burst)
        self._clock = clock
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, time of that count

    def __len__(self) -> int:
        return len(self._buckets)

    def take(self, name: str) -> None:
        """Takes one token from the caller's bucket.

        Raises:
            RateLimited: the bucket is empty.
        """
        tokens = self._tokens(name)
        if tokens < 1.0:
            wait_s = (1.0 - tokens) / self._per_s
            raise RateLimited(f"too many {self._what}: try again in {wait_s:.3g} s", wait_s)
        self._keep(name, tokens - 1.0)

    def take_on_credit(self, name: str, at_most_s: float) -> float:
        """Takes one token from the caller's bucket, on credit if it is empty.

        Returns:
            seconds until the bucket is out of debt: callers who wait for so long keep to the rate. The debt
            does not grow beyond ``at_most_s``.
        """
        tokens = max(self._tokens(name) - 1.0, -at_most_s * self._per_s)
        self._keep(name, tokens)
        return max(0.0, -tokens / self._per_s)

    def _tokens(self, name: str) -> float:
        now = self._clock()
        tokens, then = self._buckets.get(name, (self._burst, now))
        return min(self._burst, tokens + (now - then) * self._per_s)

    def _keep(self, name: str, tokens: float) -> None:
        self._buckets[name] = (tokens, self._clock())
        self._buckets.move_to_end(name)
        if len(self._buckets) > MAX_CALLERS:
            self._buckets.popitem(last=False)


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
        key_id, secret = parsed
        key = self._key(key_id)
        if not key.matches(secret):
            raise Unauthorized(NO_SUCH_KEY)
        return _principal_of(key)

    def signer(self, signature: QuerySignature, asked: Asked) -> tuple[Principal, SigningKey]:
        """Returns the caller who signed a query, and the keys of its signatures.

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
        return _principal_of(key), signing

    def _key(self, key_id: str) -> ApiKey:
        if self.age_s > self._max_age_s:
            raise StoreUnavailable("the API keys cannot be read")
        key = self._known.get(key_id)  # ids are not secret: the time of this look-up reveals nothing
        if key is None:
            raise Unauthorized(NO_SUCH_KEY)
        return key


class Authenticator:
    """Identifies callers and limits their rates. For use by one event loop.

    Args:
        tokens: None means that only API keys are accepted.

    Attributes:
        keys: None means that authentication is off: credentials are ignored.
    """

    def __init__(self, settings: Settings, keys: KeyRing | None, tokens: TokenVerifier | None) -> None:
        self.keys, self._tokens = keys, tokens
        exposed = bool(exposed_at(settings))
        per_s = chosen_limit(settings.localize_per_s, DEFAULT_LOCALIZE_PER_S, exposed)
        minutes = build_minutes_per_day(settings)
        per_hour = max(BUILDS_PER_HOUR, minutes / 24) if minutes else 0.0
        changes_per_min = CHANGES_PER_MIN if exposed else 0.0
        self._limits: dict[str, RateLimit | None] = {
            "localize": _limit("queries", per_s, _LOCALIZE_BURST_S * per_s),
            "build": _limit("builds", per_hour / 3600, per_hour),
            "change": _limit("changes of this map", changes_per_min / 60, changes_per_min),
        }
        self._failures = RateLimit("invalid credentials", AUTH_FAILURES_PER_MIN / 60, AUTH_FAILURES_PER_MIN)

    @property
    def is_on(self) -> bool:
        """True if callers need a credential."""
        return self.keys is not None

    async def authenticate(self, credential: str | None, address: str) -> Principal:
        """Returns the caller.

        Args:
            credential: an API key or a token; None if the request has none.
            address: of the caller; invalid credentials are counted by address.

        Raises:
            Unauthorized: missing or invalid credential.
            RateLimited: too many invalid credentials from this address. A valid credential is still accepted,
                because robots share addresses.
            StoreUnavailable, Overloaded: the credential cannot be checked now.
        """
        if self.keys is None:
            return Principal(f"address:{address}")
        try:
            if not credential:
                raise Unauthorized("this service needs an API key or a token")
            if credential.startswith(_API_KEY) or self._tokens is None:
                return self.keys.principal(credential)
            return await self._tokens.principal(credential)
        except Unauthorized as error:
            if credential:
                self.count_refusal(address, error)
            raise

    def count_refusal(self, address: str, error: Unauthorized) -> None:
        """Counts and logs an invalid credential.

        Raises:
            RateLimited: too many from this address.
        """
        self._failures.take(address)
        _log.info("refused a credential", address=address, reason=str(error))

    async def authorize(
        self, credential: str | None, address: str, needs: Needs, map_id: str | None = None
    ) -> Principal:
        """Returns the caller if it may make the request.

        Raises:
            Unauthorized, RateLimited, StoreUnavailable, Overloaded: see ``authenticate``.
            Forbidden, RateLimited: see ``permit``.
        """
        caller = await self.authenticate(credential, address)
        self.permit(caller, needs, map_id)
        return caller

    def permit(self, caller: Principal, needs: Needs, map_id: str | None = None) -> None:
        """Checks what a request needs, and counts it against its rate limit.

        Args:
            map_id: map in the address of the request. Requests for it are counted apart.

        Raises:
            Forbidden: see ``Principal.check``.
            RateLimited: there were too many.
        """
        note(caller=caller.name)
        caller.check(needs.scope, map_id)
        limit = self._limits.get(needs.rate)
        if limit is not None:
            limit.take(f"{caller.name} {map_id}" if map_id else caller.name)


@dataclass(frozen=True)
class Permission:
    """Permission of one request, checked again and again because a key can expire or be revoked.

    Attributes:
        map_id: the map in the path of the request, if any.
    """

    authenticator: Authenticator
    credential: str | None
    address: str
    scope: Scope
    map_id: str | None

    async def check(self, map_id: str | None = None) -> None:
        """Checks that the permission is still valid.

        Args:
            map_id: the map of the request, if it is not in the path.

        Raises:
            FirstfixError: see ``Authenticator.authorize``.
        """
        needs = Needs(self.scope)
        await self.authenticator.authorize(self.credential, self.address, needs, map_id or self.map_id)


@asynccontextmanager
async def open_authenticator(
    settings: Settings, store: Store, metrics: Metrics
) -> AsyncIterator[Authenticator]:
    """Opens the authenticator that the settings ask for, and refreshes its keys until the block ends.

    Raises:
        InvalidOption: the settings cannot be used.
    """
    async with AsyncExitStack() as stack:
        keys, tokens = None, None
        if settings.auth == "on":
            keys = KeyRing(ApiKeys(store), KEYS_MAX_AGE_S)
            refresh_keys, every_s = KEYS.route(keys.refresh), KEYS_REFRESH_S
            await refresh_keys()
            PeriodicTask("refresh API keys", refresh_keys, every_s, first_after_s=every_s).start(stack)
        if keys is not None and settings.jwt_jwks is not None:
            from .jwks import REFRESH_S  # PyJWT is loaded only if tokens are accepted
            from .token_verifier import TokenVerifier

            tokens = TokenVerifier(settings)
            await tokens.jwks.refresh()
            PeriodicTask(
                "refresh issuer keys", tokens.jwks.refresh, REFRESH_S, first_after_s=REFRESH_S
            ).start(stack)
        metrics.keys_age.set_function(lambda: 0.0 if keys is None else keys.age_s)
        yield Authenticator(settings, keys, tokens)


def _limit(what: str, per_s: float, burst: float) -> RateLimit | None:
    return RateLimit(what, per_s, burst) if per_s else None


def build_minutes_per_day(settings: Settings) -> float:
    """Returns the build minutes that one caller has per day; 0 means that no limit of builds applies."""
    exposed = bool(exposed_at(settings))
    return chosen_limit(settings.build_minutes_per_day, DEFAULT_BUILD_MINUTES_PER_DAY, exposed)


def chosen_limit(given: float | None, default: float, exposed: bool) -> float:
    """Returns the given limit, or the default; 0 means no limit.

    Args:
        default: used if the service can be reached from other machines; otherwise there is no limit.
    """
    if given is not None:
        return given
    return default if exposed else 0.0


def _principal_of(key: ApiKey) -> Principal:
    if key.is_expired(datetime.now(timezone.utc)):
        raise Unauthorized(f"API key {key.key_id} has expired")
    return Principal(f"key:{key.key_id}", key.grant)

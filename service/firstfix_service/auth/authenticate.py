"""Authentication of callers for both transports: API keys, permissions, and rate limits."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import structlog

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Scope
from firstfix.errors import Unauthorized
from firstfix.store.store import Store

from ..security_check import exposed_at
from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import note
from ..thread_pools import KEYS
from ..thread_pools.background import PeriodicTask
from .key_ring import KeyRing
from .principal import Needs, Principal
from .rate_limit import RateLimit

if TYPE_CHECKING:
    from .token_verifier import TokenVerifier

_log = structlog.get_logger(__name__)
_API_KEY = "ffx_"
CHECK_S = 1.0  # between two checks of a permission: they read memory, and verify the signature of a token
# For one caller of an exposed service
DEFAULT_LOCALIZE_PER_S, DEFAULT_BUILD_MINUTES_PER_DAY = 50.0, 1440.0
BUILDS_PER_HOUR = 60.0  # or more, if a caller may have so many minutes that each build could take one
CHANGES_PER_MIN = 60.0  # of each map: each change stays in its log for ever
AUTH_FAILURES_PER_MIN = 60.0  # of an address: nobody guesses 256 bits, but each guess is a line in the log
# A revoked key goes on working until the next listing of the keys, or while the store is away.
KEYS_REFRESH_S, KEYS_MAX_AGE_S = 5.0, 3600.0
_LOCALIZE_BURST_S = 5.0


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

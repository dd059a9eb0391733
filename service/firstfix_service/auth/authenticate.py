"""Authentication of callers for both transports: API keys, permissions, and rate limits."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import structlog

from firstfix.access.api_keys import ApiKeys, parse_token
from firstfix.access.permissions import Scope
from firstfix.errors import Unauthorized
from firstfix.store.store import Store

from ..limits.limits import Limits
from ..limits.rate import Rate
from ..settings import Settings
from ..telemetry.metrics import Metrics
from ..telemetry.request_scope import note
from ..thread_pools import KEYS
from ..thread_pools.background import PeriodicTask
from .key_ring import KeyRing
from .new_keys import NewKeys
from .principal import Needs, Principal

if TYPE_CHECKING:
    from .token_verifier import TokenVerifier

_log = structlog.get_logger(__name__)
_API_KEY = "ffx_"
CHECK_S = 1.0  # between two checks of a permission: they read memory, and verify the signature of a token
# A revoked key goes on working until the next listing of the keys, or while the store is away.
KEYS_REFRESH_S, KEYS_MAX_AGE_S = 5.0, 3600.0


class Authenticator:
    """Identifies callers and limits their rates. For use by one event loop.

    Args:
        tokens: None means that only API keys are accepted.

    Attributes:
        keys: None means that authentication is off: credentials are ignored.
    """

    def __init__(self, limits: Limits, keys: KeyRing | None, tokens: TokenVerifier | None) -> None:
        self.keys, self._tokens = keys, tokens
        self._new_keys = None if keys is None else NewKeys(keys, limits, time.monotonic)
        self._rates: dict[str, Rate | None] = {
            "localize": _rate("queries", limits.localize_per_s, limits.localize_burst_s),
            "build": _rate("builds", limits.builds_per_hour / 3600, 3600),
            "change": _rate("changes of this map", limits.changes_per_min / 60, 60),
        }
        failures_per_min = limits.auth_failures_per_min
        self._failures = Rate("invalid credentials", failures_per_min / 60, failures_per_min)

    @property
    def is_on(self) -> bool:
        """True if callers need a credential."""
        return self.keys is not None

    async def authenticate(self, credential: str | None, address: str) -> Principal:
        """The caller.

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
            return _anybody_at(address)
        try:
            if not credential:
                raise Unauthorized("this service needs an API key or a token")
            if credential.startswith(_API_KEY) or self._tokens is None:
                if (parsed := parse_token(credential)) is not None:
                    await self.look_up(parsed[0], address)
                return self.keys.principal(credential)
            return await self._tokens.principal(credential)
        except Unauthorized as error:
            if credential:
                self.count_refusal(address, error)
            raise

    async def look_up(self, key_id: str, address: str) -> None:
        """Learn a key that was made since the keys were listed, within limits."""
        if self._new_keys is not None:
            await self._new_keys.look_up(key_id, address)

    def count_refusal(self, address: str, error: Unauthorized) -> None:
        """Count and log an invalid credential.

        Raises:
            RateLimited: too many from this address.
        """
        self._failures.take(address)
        _log.info("refused a credential", address=address, reason=str(error))

    async def authorize(
        self, credential: str | None, address: str, needs: Needs, map_id: str | None = None
    ) -> Principal:
        """The caller if it may make the request.

        Raises:
            Unauthorized, RateLimited, StoreUnavailable, Overloaded: see ``authenticate``.
            Forbidden, RateLimited: see ``permit``.
        """
        caller = await self.authenticate(credential, address)
        self.permit(caller, needs, map_id)
        return caller

    def permit(self, caller: Principal, needs: Needs, map_id: str | None = None) -> None:
        """Check what a request needs, and count it against its rate limit.

        Args:
            map_id: map in the address of the request. Requests for it are counted apart.

        Raises:
            Forbidden: see ``Principal.check``.
            RateLimited: there were too many.
        """
        note(caller=caller.name)
        if caller.key_name:
            note(key_name=caller.key_name)
        caller.check(needs.scope, map_id)
        limit = self._rates.get(needs.rate)
        if limit is not None:
            limit.take(f"{caller.name} {map_id}" if map_id else caller.name)


@lru_cache(Limits.max_names)
def _anybody_at(address: str) -> Principal:
    return Principal(f"address:{address}")


class Permission(NamedTuple):
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
        """Check that the permission is still valid.

        Args:
            map_id: the map of the request, if it is not in the path.

        Raises:
            FirstfixError: see ``Authenticator.authorize``.
        """
        needs = Needs(self.scope)
        await self.authenticator.authorize(self.credential, self.address, needs, map_id or self.map_id)


@asynccontextmanager
async def open_authenticator(
    settings: Settings, limits: Limits, store: Store, metrics: Metrics
) -> AsyncIterator[Authenticator]:
    """Open the authenticator that the settings ask for, and refresh its keys until the block ends.

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
        yield Authenticator(limits, keys, tokens)


def _rate(what: str, per_s: float, burst_s: float) -> Rate | None:
    return Rate(what, per_s, burst_s * per_s) if per_s else None

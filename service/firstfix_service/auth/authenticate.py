"""Who is asking, by the credential that comes with a request: the same for both transports."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from typing import TYPE_CHECKING

import structlog

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Scope
from firstfix.errors import Unauthorized
from firstfix.store.store import Store

from ..exposure import exposed_at
from ..lanes import KEYS
from ..settings import Settings
from ..telemetry.metrics import Metrics
from .key_ring import KeyRing
from .principal import Caller
from .rate_limit import RateLimit

if TYPE_CHECKING:
    from .token_verifier import TokenVerifier

_log = structlog.get_logger(__name__)
_API_KEY = "ffx_"
# Of one caller, where strangers can be some; changes: of one map.
DEFAULT_LOCALIZE_PER_S, DEFAULT_BUILDS_PER_HOUR, DEFAULT_CHANGES_PER_MIN = 50.0, 60.0, 60.0
_LOCALIZE_BURST_S = 5.0


class Access:
    """Tells callers apart and limits how often they come. One event loop's.

    Args:
        keys: None: nobody is asked for a credential, and what comes is not looked at.
        tokens: None: there are API keys alone.
    """

    def __init__(self, settings: Settings, keys: KeyRing | None, tokens: TokenVerifier | None) -> None:
        self._keys, self._tokens = keys, tokens
        exposed = bool(exposed_at(settings))
        per_s = chosen_limit(settings.localize_per_s, DEFAULT_LOCALIZE_PER_S, exposed)
        per_hour = chosen_limit(settings.builds_per_hour, DEFAULT_BUILDS_PER_HOUR, exposed)
        changes_per_min = chosen_limit(settings.changes_per_min, DEFAULT_CHANGES_PER_MIN, exposed)
        per_min = settings.auth_failures_per_min
        self._limits = {
            "localize": _limit("queries", per_s, _LOCALIZE_BURST_S * per_s),
            "build": _limit("builds", per_hour / 3600, per_hour),
            "change": _limit("changes of this map", changes_per_min / 60, changes_per_min),
        }
        self._failures = _limit("credentials that are worth nothing", per_min / 60, per_min)

    @property
    def is_on(self) -> bool:
        return self._keys is not None

    async def caller(self, credential: str | None, address: str) -> Caller:
        """
        Args:
            credential: an API key or a token; None: none came.
            address: for the limits of callers without a credential that is worth anything.

        Raises:
            Unauthorized: none, or one that is worth nothing.
            RateLimited: the same, once too often from this address. One that is good works all the same,
                for robots share addresses.
            StoreUnavailable, Overloaded: it cannot be checked now.
        """
        if self._keys is None:
            return Caller(f"address:{address}")
        try:
            if not credential:
                raise Unauthorized("this service asks for an API key or a token")
            if credential.startswith(_API_KEY) or self._tokens is None:
                return self._keys.caller(credential)
            return await self._tokens.caller(credential)
        except Unauthorized as error:
            if credential and self._failures is not None:
                self._failures.take(address)
                _log.info("refused a credential", address=address, reason=str(error))
            raise

    async def check(
        self, credential: str | None, scope: Scope, map_id: str | None, *, address: str = "zenoh"
    ) -> Caller:
        """The caller, who may do this.

        Raises:
            Unauthorized, RateLimited, StoreUnavailable, Overloaded: as ``caller``.
            Forbidden: as ``Caller.check``.
        """
        caller = await self.caller(credential, address)
        caller.check(scope, map_id)
        return caller

    def take(self, what: str, caller: Caller, map_id: str = "") -> None:
        """Counts a query (``localize``), a build (``build``) or a change of a map (``change``) of this
        caller. Changes count by map: each is an entry in that map's log.

        Raises:
            RateLimited: there were too many.
        """
        limit = self._limits[what]
        if limit is not None:
            limit.take(f"{caller.name} {map_id}" if map_id else caller.name)


@asynccontextmanager
async def open_access(settings: Settings, store: Store, metrics: Metrics) -> AsyncIterator[Access]:
    """Access as the settings say, kept current while the block lasts.

    Raises:
        InvalidOption: settings that cannot be used.
    """
    keys, tokens = None, None
    running: list[asyncio.Task[None]] = []
    if settings.auth == "on":
        keys = KeyRing(ApiKeys(store), settings.keys_max_age_s)
        await KEYS.run(keys.refresh)
        running.append(_every(settings.keys_refresh_s, _in_thread(keys.refresh)))
    if keys is not None and settings.jwt_jwks is not None:
        from .jwks import REFRESH_S  # PyJWT is loaded only where there are tokens
        from .token_verifier import TokenVerifier

        tokens = TokenVerifier(settings)
        await tokens.jwks.refresh()
        running.append(_every(REFRESH_S, tokens.jwks.refresh))
    metrics.keys_age.set_function(lambda: 0.0 if keys is None else keys.age_s)
    try:
        yield Access(settings, keys, tokens)
    finally:
        for task in running:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task


def _every(interval_s: float, work: Callable[[], Awaitable[None]]) -> asyncio.Task[None]:
    async def run() -> None:
        while True:
            await asyncio.sleep(interval_s)
            try:
                await work()
            except Exception:  # without it keys would never be revoked again
                _log.exception("a look for keys failed")

    return asyncio.create_task(run(), name="access")


def _in_thread(work: Callable[[], None]) -> Callable[[], Awaitable[None]]:
    return lambda: KEYS.run(work)


def _limit(what: str, per_s: float, burst: float) -> RateLimit | None:
    return RateLimit(what, per_s, burst) if per_s else None


def chosen_limit(given: float | None, default: float, exposed: bool) -> float:
    """A limit; 0: none.

    Args:
        default: where strangers can be some of the callers.
    """
    if given is not None:
        return given
    return default if exposed else 0.0

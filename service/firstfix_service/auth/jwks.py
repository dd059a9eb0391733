"""Public keys of the token issuer (a JWK set), read from a URL or a file and kept in memory."""

from __future__ import annotations

import asyncio
import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import jwt
import structlog

from firstfix.errors import InvalidOption, Overloaded, Unauthorized
from firstfix.wire.endpoints import is_loopback

from ..thread_pools import KEYS

_log = structlog.get_logger(__name__)
REFRESH_S = 300.0
REFETCH_AFTER_S = 10.0  # minimum between two reads, however many tokens name unknown keys
MAX_AGE_S = 86400.0  # keys that could not be read again for so long may have been withdrawn
_TIMEOUT_S = 5.0
_MAX_BYTES = 256 << 10
_MAX_KEYS = 100
# Key type and curve for each algorithm. A symmetric key (oct) is never accepted: published keys are public.
KEY_OF: dict[str, tuple[str, str | None]] = {
    "RS256": ("RSA", None),
    "RS384": ("RSA", None),
    "RS512": ("RSA", None),
    "ES256": ("EC", "P-256"),
    "ES384": ("EC", "P-384"),
    "EdDSA": ("OKP", "Ed25519"),
}


class Jwks:
    """Keys of one issuer. For use by one event loop.

    Args:
        source: an https URL (or http on loopback), or the path of a file.

    Raises:
        InvalidOption: the URL is not of this form.
    """

    def __init__(self, source: str, clock: Callable[[], float] = time.monotonic) -> None:
        self._source = source
        self._is_url = "://" in source
        if self._is_url:
            _check_url(source)
        self._clock = clock
        self._keys: list[Mapping[str, Any]] = []
        self._read_at: float | None = None
        self._tried_at: float | None = None
        self._fetching: asyncio.Task[None] | None = None

    async def key(self, key_id: str | None, algorithm: str) -> jwt.PyJWK:
        """The public key that a token's header names.

        An unknown key is looked up at the issuer, which may have changed its keys, at most every
        ``REFETCH_AFTER_S``.

        Raises:
            Unauthorized: the issuer has no key with this id for this algorithm.
            Overloaded: the issuer's keys could not be read for ``MAX_AGE_S``.
        """
        found = self._find(key_id, algorithm)
        if found is None and self._may_fetch():
            await self.refresh()
            found = self._find(key_id, algorithm)
        if self._read_at is None or self._clock() - self._read_at > MAX_AGE_S:
            raise Overloaded("the keys of the token issuer cannot be read: try again")
        if found is None:
            raise Unauthorized("the token is not signed by a key of its issuer")
        return found

    async def refresh(self) -> None:
        """Read the keys again. If that fails, the keys in memory stay. Concurrent calls share one read."""
        if self._fetching is None:
            self._fetching = asyncio.create_task(self._refresh(), name="jwks")
        await asyncio.shield(self._fetching)

    def _may_fetch(self) -> bool:
        is_reading = self._fetching is not None
        return is_reading or self._tried_at is None or self._clock() - self._tried_at >= REFETCH_AFTER_S

    async def _refresh(self) -> None:
        self._tried_at = self._clock()
        try:
            self._keys = _parse(await self._fetch() if self._is_url else await KEYS.run(self._load))
            self._read_at = self._clock()
        except (httpx.HTTPError, OSError, ValueError, RecursionError) as error:
            _log.warning(
                "cannot read the keys of the token issuer",
                source=self._source,
                error=str(error) or repr(error),
            )
        finally:
            self._fetching = None

    async def _fetch(self) -> bytes:
        body = bytearray()
        context = await KEYS.run(httpx.create_ssl_context)  # it reads the file of all authorities
        async with (
            asyncio.timeout(_TIMEOUT_S),
            httpx.AsyncClient(verify=context, headers={"Accept-Encoding": "identity"}) as client,
            client.stream("GET", self._source) as answer,
        ):
            if answer.status_code != 200:  # a redirect is refused too: it could lead anywhere
                raise ValueError(f"it answered {answer.status_code}")
            async for part in answer.aiter_raw():  # raw: a compressed body could expand without limit
                body += part
                if len(body) > _MAX_BYTES:
                    raise ValueError(f"it answered more than {_MAX_BYTES} bytes")
        return bytes(body)

    def _load(self) -> bytes:
        with Path(self._source).open("rb") as file:
            body = file.read(_MAX_BYTES + 1)
        if len(body) > _MAX_BYTES:
            raise ValueError(f"it has more than {_MAX_BYTES} bytes")
        return body

    def _find(self, key_id: str | None, algorithm: str) -> jwt.PyJWK | None:
        matching = [key for key in self._keys if _fits(key, algorithm)]
        named = [key for key in matching if key.get("kid") == key_id]
        if key_id is None:  # without an id the key must be unique
            named = matching if len(matching) == 1 else []
        for key in named:
            try:
                return jwt.PyJWK(dict(key), algorithm)
            except jwt.PyJWTError:
                continue
        return None


def _check_url(url: str) -> None:
    parts = urlsplit(url)
    secure = parts.scheme == "https" or (parts.scheme == "http" and is_loopback(parts.hostname or ""))
    if not secure or not parts.hostname:
        raise InvalidOption(
            "FIRSTFIX_JWT_JWKS must be an https URL or a file: keys over plain HTTP can be forged"
        )
    if parts.username is not None or parts.password is not None:
        raise InvalidOption("FIRSTFIX_JWT_JWKS must not contain a user or a password")


def _parse(body: bytes) -> list[Mapping[str, Any]]:
    """Parse a JWK set.

    Raises:
        ValueError: it is not a JWK set, or has a private or symmetric key.
    """
    document = json.loads(body)
    keys = document.get("keys") if isinstance(document, dict) else None
    if not isinstance(keys, list) or len(keys) > _MAX_KEYS:
        raise ValueError(f"it is not a set of up to {_MAX_KEYS} JSON Web Keys")
    found: list[Mapping[str, Any]] = [key for key in keys if isinstance(key, dict)]
    if any("d" in key or "k" in key for key in found):
        raise ValueError("it contains a private or symmetric key, which an issuer must never publish")
    return found


def _fits(key: Mapping[str, Any], algorithm: str) -> bool:
    kind, curve = KEY_OF[algorithm]
    return (
        key.get("kty") == kind
        and (curve is None or key.get("crv") == curve)
        and key.get("use", "sig") == "sig"
        and key.get("alg", "RS256" if kind == "RSA" else algorithm) == algorithm
    )

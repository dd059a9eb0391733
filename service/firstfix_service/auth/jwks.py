"""The keys of the tokens' issuer (a JWK set), from its URL or a file, kept in memory and kept current."""

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

from ..exposure import is_loopback
from ..lanes import KEYS

_log = structlog.get_logger(__name__)
REFRESH_S = 300.0
REFETCH_AFTER_S = 10.0  # at the least, however many tokens name keys that are not known
MAX_AGE_S = 86400.0  # an issuer that cannot be reached for so long may have withdrawn its keys
_TIMEOUT_S = 5.0
_MAX_BYTES = 256 << 10
_MAX_KEYS = 100
# What a key has to be for a signature to be checked with it; a secret (oct) never is one of an issuer's.
_KEY_OF: dict[str, tuple[str, str | None]] = {
    "RS256": ("RSA", None),
    "RS384": ("RSA", None),
    "RS512": ("RSA", None),
    "ES256": ("EC", "P-256"),
    "ES384": ("EC", "P-384"),
    "EdDSA": ("OKP", "Ed25519"),
}


class Jwks:
    """One event loop's.

    Args:
        source: an https URL (http on loopback alone), or the path of a file.

    Raises:
        InvalidOption: another URL.
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
        """The public key that a token's header names. One that is not known is looked for at the issuer,
        which may have changed its keys, but seldom.

        Raises:
            Unauthorized: there is none of that id for that algorithm.
            Overloaded: the issuer's keys could not be had for too long.
        """
        found = self._find(key_id, algorithm)
        if found is None and self._may_fetch():
            await self.refresh()
            found = self._find(key_id, algorithm)
        if self._read_at is None or self._clock() - self._read_at > MAX_AGE_S:
            raise Overloaded("the keys of the tokens' issuer cannot be had: try again")
        if found is None:
            raise Unauthorized("the token is signed by no key of its issuer")
        return found

    async def refresh(self) -> None:
        """Reads the keys anew; who comes while that goes on waits for the same answer. A failure leaves
        them as they are."""
        if self._fetching is None:
            self._fetching = asyncio.create_task(self._refresh(), name="jwks")
        await asyncio.shield(self._fetching)

    def _may_fetch(self) -> bool:
        going_on = self._fetching is not None
        return going_on or self._tried_at is None or self._clock() - self._tried_at >= REFETCH_AFTER_S

    async def _refresh(self) -> None:
        self._tried_at = self._clock()
        try:
            self._keys = _parse(await self._fetch() if self._is_url else await KEYS.run(self._load))
            self._read_at = self._clock()
        except (httpx.HTTPError, OSError, ValueError, RecursionError) as error:
            _log.warning(
                "cannot read the issuer's keys", source=self._source, error=str(error) or repr(error)
            )
        finally:
            self._fetching = None

    async def _fetch(self) -> bytes:
        body = bytearray()
        async with (
            asyncio.timeout(_TIMEOUT_S),
            httpx.AsyncClient(headers={"Accept-Encoding": "identity"}) as client,
            client.stream("GET", self._source) as answer,
        ):
            if answer.status_code != 200:  # a redirect too: it could lead anywhere
                raise ValueError(f"it answered {answer.status_code}")
            async for part in answer.aiter_raw():  # as it comes: nothing is there to expand
                body += part
                if len(body) > _MAX_BYTES:
                    raise ValueError(f"it answered over {_MAX_BYTES} bytes")
        return bytes(body)

    def _load(self) -> bytes:
        with Path(self._source).open("rb") as file:
            body = file.read(_MAX_BYTES + 1)
        if len(body) > _MAX_BYTES:
            raise ValueError(f"it has over {_MAX_BYTES} bytes")
        return body

    def _find(self, key_id: str | None, algorithm: str) -> jwt.PyJWK | None:
        fitting = [key for key in self._keys if _fits(key, algorithm)]
        named = [key for key in fitting if key.get("kid") == key_id]
        if key_id is None:  # then there must be no choice
            named = fitting if len(fitting) == 1 else []
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
        raise InvalidOption("FIRSTFIX_JWT_JWKS is an https URL or a file: keys over plain HTTP prove nothing")
    if parts.username is not None or parts.password is not None:
        raise InvalidOption("FIRSTFIX_JWT_JWKS holds no secrets")


def _parse(body: bytes) -> list[Mapping[str, Any]]:
    """
    Raises:
        ValueError: no JWK set.
    """
    document = json.loads(body)
    keys = document.get("keys") if isinstance(document, dict) else None
    if not isinstance(keys, list) or len(keys) > _MAX_KEYS:
        raise ValueError(f"it is no set of up to {_MAX_KEYS} JSON Web Keys")
    found: list[Mapping[str, Any]] = [key for key in keys if isinstance(key, dict)]
    if any("d" in key or "k" in key for key in found):
        raise ValueError("it holds a private or symmetric key: an issuer that gives these away is no issuer")
    return found


def _fits(key: Mapping[str, Any], algorithm: str) -> bool:
    kind, curve = _KEY_OF[algorithm]
    return (
        key.get("kty") == kind
        and (curve is None or key.get("crv") == curve)
        and key.get("use", "sig") == "sig"
        and key.get("alg", algorithm) == algorithm
    )

"""Verification of JSON Web Tokens: the signature of the issuer, the audience, the time and the scopes."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from typing import Any

import jwt

from firstfix.access.permissions import ALL_MAPS, Grant, Scope
from firstfix.errors import FirstfixError, InvalidOption, Unauthorized

from ..settings import Settings
from .jwks import KEY_OF, Jwks
from .principal import Principal

MAX_TOKEN_CHARS = 8192
ALGORITHMS = tuple(KEY_OF)
LEEWAY_S = 30.0  # difference of the clocks of two machines that keep time
MAX_SUBJECT_CHARS = 200
_REQUIRED = ["exp", "iss", "aud", "sub"]
_SCOPES = {scope.value: scope for scope in Scope}


class TokenVerifier:
    """Accepts tokens of one issuer for one audience. For use by one event loop.

    Raises:
        InvalidOption: the settings name no issuer or no audience. Without these, a token that was made for
            another service would be accepted.
    """

    def __init__(self, settings: Settings) -> None:
        if settings.jwt_jwks is None or not settings.jwt_issuer or not settings.jwt_audience:
            raise InvalidOption("FIRSTFIX_JWT_JWKS needs FIRSTFIX_JWT_ISSUER and FIRSTFIX_JWT_AUDIENCE")
        self.jwks = Jwks(settings.jwt_jwks)
        self._settings = settings

    async def principal(self, token: str) -> Principal:
        """The caller that a token names.

        Raises:
            Unauthorized: it is not a token, has another issuer or audience, or is not valid at this time.
            Overloaded: see ``Jwks.key``.
        """
        try:
            return await self._verified(token)
        except (jwt.PyJWTError, ValueError, RecursionError) as error:
            raise Unauthorized(f"the token is not accepted: {str(error)[:200]}") from None

    async def _verified(self, token: str) -> Principal:
        if len(token) > MAX_TOKEN_CHARS:
            raise Unauthorized(f"the token has over {MAX_TOKEN_CHARS} characters")
        header = jwt.get_unverified_header(token)
        algorithm, key_id = header.get("alg"), header.get("kid")
        if algorithm not in ALGORITHMS:  # none and HS* are never among them
            accepted = ", ".join(ALGORITHMS)
            raise Unauthorized(f"the signature algorithm is not accepted, only {accepted}")
        key = await self.jwks.key(key_id, algorithm)
        claims = jwt.decode(
            token,
            key,
            algorithms=[algorithm],
            audience=self._settings.jwt_audience,
            issuer=self._settings.jwt_issuer,
            leeway=LEEWAY_S,
            options={"require": _REQUIRED, "enforce_minimum_key_length": True},
        )
        return Principal(f"jwt:{_subject(claims['sub'])}", self._grant(claims))

    def _grant(self, claims: Mapping[str, Any]) -> Grant:
        """Read the scopes of this service. Other names are ignored: they are scopes of other services."""
        prefix = self._settings.jwt_scope_prefix
        names = [*_words(claims.get("scope")), *_words(claims.get("scp"))]
        given = [name.removeprefix(prefix) for name in names if name.startswith(prefix)]
        scopes = frozenset(_SCOPES[name] for name in given if name in _SCOPES)
        maps: tuple[str, ...] = ALL_MAPS
        if self._settings.jwt_maps_claim is not None:
            maps = tuple(_words(claims.get(self._settings.jwt_maps_claim)))
        try:
            return Grant.parse((scope.value for scope in scopes), maps)
        except FirstfixError:  # no scope, or an invalid pattern
            return Grant(frozenset(), ())


def _subject(claim: str) -> str:
    """A printable name for a subject, different for any two subjects."""
    text = ascii(claim)[1:-1]
    if len(text) <= MAX_SUBJECT_CHARS:
        return text
    return f"{text[:MAX_SUBJECT_CHARS]}:{hashlib.sha256(claim.encode('utf-8', 'surrogatepass')).hexdigest()}"


def _words(claim: Any) -> list[str]:
    """The words of a claim: a list, or a text with spaces between the words."""
    if isinstance(claim, str):
        return claim.split()
    return [word for word in claim if isinstance(word, str)] if isinstance(claim, list) else []

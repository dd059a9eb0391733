"""Callers of zenoh queries, by the attachment: a signature with an API key, or a credential as it is.

Whoever may declare a zenoh key sees the queries on it. So a credential as it is, which works elsewhere too,
is only taken where strangers have no part in the zenoh network (``security_check.open_zenoh``).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from firstfix.access.permissions import Scope
from firstfix.errors import FirstfixError, Unauthorized
from firstfix.wire.signature import Asked, QuerySignature

from ..auth.authenticate import Authenticator
from ..auth.principal import Needs, Principal
from ..auth.signed_queries import SignedQueries, SignedQuery
from ..security_check import open_zenoh
from ..settings import Settings
from ..thread_pools import SIGNATURES

_NEEDS = Needs(Scope.LOCALIZE, "localize")
TRUSTED = "zenoh"  # name of a caller whom zenoh's own access rules let through
MAX_CREDENTIAL_BYTES = 16 << 10
_SIGNED = b"FFQ"  # first bytes of every version of a signature; no API key and no token begins so
_SHORT_BYTES = 256 << 10  # of a payload that is hashed at once, in under a millisecond


@dataclass
class ZenohCaller:
    """Caller of one query.

    Attributes:
        signed: None: the query has no signature, or a wrong one.
        refused: why the signature is not accepted.
        is_repeated: the query was received before.
    """

    signed: SignedQuery | None = None
    refused: FirstfixError | None = None
    is_repeated: bool = False

    def encoding(self, is_ok: bool, encoding: str, payload: bytes) -> str:
        """The encoding of a reply: signed, if the query is.

        The refusal of a repeated query is not signed: the first one may still get its answer, and a client
        takes a signed refusal to be final.
        """
        if self.signed is None or self.is_repeated:
            return encoding
        return self.signed.key.signed_encoding(self.signed.signature, is_ok, encoding, payload)

    async def check_body(self, body: bytes) -> None:
        """Check that a signed query has the payload that was signed.

        Raises:
            Unauthorized: it has another one.
        """
        if self.signed is None:
            return
        fits = self.signed.signature.fits
        if not (fits(body) if len(body) <= _SHORT_BYTES else await SIGNATURES.run(fits, body)):
            raise Unauthorized("the payload is not the one that was signed")


class ZenohCallers:
    """Identifies the callers of zenoh queries."""

    def __init__(self, settings: Settings, authenticator: Authenticator) -> None:
        self._authenticator = authenticator
        self._signatures = None if authenticator.keys is None else SignedQueries(authenticator.keys)
        self._is_trusted = settings.zenoh_trusted
        self._is_open = authenticator.is_on and bool(open_zenoh(settings))

    def look(self, query: Any) -> ZenohCaller:
        """The caller, after a look at its signature. Changes nothing. Thread-safe, and quick."""
        attachment, signatures = query.attachment, self._signatures
        if signatures is None or attachment is None or len(attachment) > MAX_CREDENTIAL_BYTES:
            return ZenohCaller()
        content = attachment.to_bytes()
        if not content.startswith(_SIGNED):
            return ZenohCaller()
        try:
            asked = Asked.of(query.key_expr, query.parameters, query.encoding)
            return ZenohCaller(signatures.check(content, asked))
        except FirstfixError as error:
            return ZenohCaller(refused=error)

    async def identify(self, query: Any) -> ZenohCaller:
        """The caller, as ``look``; a key that was made since the keys were listed is looked up first."""
        attachment = query.attachment
        if (
            self._signatures is not None
            and attachment is not None
            and len(attachment) <= MAX_CREDENTIAL_BYTES
        ):
            signature = QuerySignature.parse(attachment.to_bytes())
            if signature is not None:
                await self._authenticator.look_up(signature.key_id, "zenoh")
        return self.look(query)

    async def admit(self, caller: ZenohCaller, query: Any) -> Principal:
        """The principal, with the scope ``localize`` and within its rate limit. Admits a query once.

        Raises:
            ClockSkew, RateLimited: as ``SignedQueries.accept``.
            Unauthorized: the query was received before.
            Unauthorized, Forbidden, RateLimited: as ``Authenticator.authorize``.
        """
        if caller.signed is not None and self._signatures is not None:
            caller.is_repeated = not self._signatures.accept(caller.signed)
            if caller.is_repeated:
                raise Unauthorized("this query was received before")
        if self._is_trusted:
            return Principal(TRUSTED)
        if caller.signed is not None:
            self._authenticator.permit(caller.signed.principal, _NEEDS)
            return caller.signed.principal
        if caller.refused is not None:
            if isinstance(caller.refused, Unauthorized):
                self._authenticator.count_refusal("zenoh", caller.refused)
            raise caller.refused
        credential = credential_of(query)
        if credential and self._is_open:
            raise Unauthorized(
                "strangers may read along on this zenoh network, so it takes signed queries alone, and no "
                "API key or token as it is: a client of this release signs with its API key"
            )
        return await self._authenticator.authorize(credential, "zenoh", _NEEDS)


def credential_of(query: Any) -> str | None:
    """The API key or token in a query's attachment; None without an attachment.

    Raises:
        Unauthorized: the attachment is too long.
    """
    attachment = query.attachment
    if attachment is None:
        return None
    if len(attachment) > MAX_CREDENTIAL_BYTES:
        raise Unauthorized(f"the attachment, a credential, has over {MAX_CREDENTIAL_BYTES} bytes")
    return attachment.to_bytes().decode("ascii", "replace")

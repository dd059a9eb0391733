"""Signatures of zenoh queries and their replies, by a secret that both sides derive from an API key.

A query carries a keyed hash (HMAC-SHA256) over all that it asks, and its reply one over the query's and all
that it answers. So a stranger who reads both learns nothing to ask with, and no client believes his answers.
clients/protocol/signatures.md defines every byte.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import struct
from collections.abc import Iterable
from dataclasses import dataclass, field

API_KEY = re.compile(r"ffx_([0-9a-f]{12})_([0-9a-f]{64})")
# A query's time may differ by so much from the service's clock. It covers a slow link and a clock that is set
# by NTP now and then, and bounds how long a recorded query has to be remembered.
WINDOW_S = 60
NONCE_BYTES = 16
REPLY_MARK = ";firstfix-v1="
_MAGIC = b"FFQ1"
_HEAD = struct.Struct("<4s12sQ16s32s")
_MAC_BYTES = 32
SIGNATURE_BYTES = _HEAD.size + _MAC_BYTES
_QUERY, _ANSWER = b"firstfix zenoh v1 query", b"firstfix zenoh v1 answer"
_REPLY = re.compile(rf"(.*){REPLY_MARK}([0-9a-f]{{64}})", re.DOTALL)


@dataclass(frozen=True)
class Asked:
    """Parts of a query besides its payload.

    Attributes:
        key: the key expression.
        parameters: names and values of the selector, in any order.
        encoding: of the payload; empty without one.
    """

    key: str
    parameters: tuple[tuple[str, str], ...]
    encoding: str

    @classmethod
    def of(cls, key: object, parameters: Iterable[tuple[str, str]], encoding: object | None) -> Asked:
        """The parts as zenoh's own objects show them. Names with an underscore first are zenoh's."""
        named = tuple(sorted(pair for pair in parameters if not pair[0].startswith("_")))
        return cls(str(key), named, "" if encoding is None else str(encoding))

    @property
    def message(self) -> bytes:
        """Every part behind its length, so that two queries never have the same bytes."""
        pairs = sorted((name.encode(), value.encode()) for name, value in self.parameters)
        texts = [text for pair in pairs for text in pair]
        return b"".join(map(_counted, (self.key.encode(), self.encoding.encode(), *texts)))


@dataclass(frozen=True)
class QuerySignature:
    """Signature that a query carries as its attachment.

    Attributes:
        time_ms: when the query was made, since 1970 (UTC).
        nonce: random bytes: no two queries have the same.
        payload_sha256: hash of the payload.
        mac: keyed hash of the above and of what the query asks.
    """

    key_id: str
    time_ms: int
    nonce: bytes
    payload_sha256: bytes
    mac: bytes

    @classmethod
    def parse(cls, attachment: bytes) -> QuerySignature | None:
        """The signature, or None if the bytes have not the form of one."""
        if len(attachment) != SIGNATURE_BYTES or not attachment.startswith(_MAGIC):
            return None
        _, key_id, time_ms, nonce, payload_sha256 = _HEAD.unpack_from(attachment)
        if not re.fullmatch(rb"[0-9a-f]{12}", key_id):
            return None
        return cls(key_id.decode(), time_ms, nonce, payload_sha256, attachment[_HEAD.size :])

    @property
    def head(self) -> bytes:
        """The bytes before the keyed hash."""
        return _HEAD.pack(_MAGIC, self.key_id.encode(), self.time_ms, self.nonce, self.payload_sha256)

    def to_bytes(self) -> bytes:
        """The attachment."""
        return self.head + self.mac

    def fits(self, payload: bytes) -> bool:
        """Whether this is the payload that was signed."""
        return hmac.compare_digest(self.payload_sha256, hashlib.sha256(payload).digest())


@dataclass(frozen=True)
class SigningKey:
    """Keys for queries and for replies, derived from one API key."""

    key_id: str
    query_key: bytes = field(repr=False)
    answer_key: bytes = field(repr=False)

    @classmethod
    def of_api_key(cls, api_key: str) -> SigningKey | None:
        """The keys, or None for a credential of another form, such as a JSON Web Token."""
        match = API_KEY.fullmatch(api_key)
        return None if match is None else cls.of_hash(match[1], hashlib.sha256(match[2].encode()).digest())

    @classmethod
    def of_hash(cls, key_id: str, secret_sha256: bytes) -> SigningKey:
        """The keys from the hash of the API key's secret, which is all that a store has of it."""
        return cls(key_id, _mac(secret_sha256, _QUERY), _mac(secret_sha256, _ANSWER))

    def sign(self, asked: Asked, payload: bytes, time_ms: int, nonce: bytes) -> QuerySignature:
        """The signature of a query.

        Args:
            payload: empty without one.
            nonce: 16 random bytes, new for each query that is sent.
        """
        unsigned = QuerySignature(self.key_id, time_ms, nonce, hashlib.sha256(payload).digest(), b"")
        return QuerySignature(
            self.key_id, time_ms, nonce, unsigned.payload_sha256, self._query_mac(unsigned, asked)
        )

    def has_signed(self, signature: QuerySignature, asked: Asked) -> bool:
        """Whether the signature is right. The payload is compared apart, with ``fits``."""
        return hmac.compare_digest(signature.mac, self._query_mac(signature, asked))

    def signed_encoding(self, query: QuerySignature, is_ok: bool, encoding: str, payload: bytes) -> str:
        """The encoding of a reply with its signature: zenoh's error replies have no attachment."""
        return f"{encoding}{REPLY_MARK}{self._reply_mac(query, is_ok, encoding, payload).hex()}"

    def has_replied(self, query: QuerySignature, is_ok: bool, signed_encoding: str, payload: bytes) -> bool:
        """Whether a reply is by the service, to this query, and unchanged."""
        match = _REPLY.fullmatch(signed_encoding)
        if match is None:
            return False
        right = self._reply_mac(query, is_ok, match[1], payload).hex()
        return hmac.compare_digest(match[2], right)

    def _query_mac(self, signature: QuerySignature, asked: Asked) -> bytes:
        return _mac(self.query_key, signature.head + asked.message)

    def _reply_mac(self, query: QuerySignature, is_ok: bool, encoding: str, payload: bytes) -> bytes:
        kind = b"\x01" if is_ok else b"\x00"
        return _mac(
            self.answer_key,
            query.mac + kind + _counted(encoding.encode()) + hashlib.sha256(payload).digest(),
        )


def _counted(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def _mac(key: bytes, message: bytes) -> bytes:
    return hmac.new(key, message, hashlib.sha256).digest()

"""API keys in an object store, with the hash of each secret instead of the secret.

    keys/<key id>.json      created once: name, grant, sha256 of the secret, times
    keys/<key id>.revoked   if it exists, the key is invalid

A token is ``ffx_<key id>_<secret>``, with 12 and 64 lower-case hex characters, so that scanners of
repositories and logs recognise it. The secret is 256 random bits, which nobody can guess from its SHA-256.
The slow, salted hash that a password needs (bcrypt, argon2) would only make every request slower. Anybody who
can write to the store can make keys, just as they could put false maps there.
"""

from __future__ import annotations

import hashlib
import hmac
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from typing import Any

from ..errors import Conflict, InvalidOption, NotFound, UnreadableRecord
from ..store.json_record import RecordKind, read_each, read_record, record_json, text_of, texts_of
from ..store.store import Store
from ..wire.signature import API_KEY
from .permissions import Grant

_FOLDER = "keys"
_KEY_ID = re.compile(r"[0-9a-f]{12}")
_RECORD, _REVOKED = ".json", ".revoked"
MAX_NAME_CHARS = 100


@dataclass(frozen=True)
class ApiKey:
    """API key without its secret.

    Attributes:
        name: for people.
        sha256: of the secret, as hex.
        created_time, expires_time: UTC, ISO 8601; ``expires_time`` is None if the key does not expire.
        revoked: the key is invalid.
    """

    key_id: str
    name: str
    grant: Grant
    sha256: str
    created_time: str
    expires_time: str | None = None
    revoked: bool = False

    def matches(self, secret: str) -> bool:
        """Whether the secret is this key's. Compares in constant time."""
        return hmac.compare_digest(self.sha256, _hash(secret))

    def is_expired(self, now: datetime) -> bool:
        """Whether the key has expired."""
        return self.expires_time is not None and now >= datetime.fromisoformat(self.expires_time)

    def to_mapping(self) -> dict[str, Any]:
        """JSON-ready form for people and programs, without the hash."""
        return {
            "key_id": self.key_id,
            "name": self.name,
            "scopes": sorted(scope.value for scope in self.grant.scopes),
            "maps": list(self.grant.maps),
            "created_time": self.created_time,
            "expires_time": self.expires_time,
            "revoked": self.revoked,
        }


class ApiKeys:
    """API keys of a store. Thread-safe. Every method raises StoreError if the store fails."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._read: dict[str, ApiKey] = {}  # records never change; damaged ones are read again

    def create(
        self, name: str, grant: Grant, expires: datetime | None = None, token: str | None = None
    ) -> tuple[ApiKey, str]:
        """Create a key. Returns it with its token: only now is the secret visible.

        Args:
            expires: with a time zone.
            token: made elsewhere, from 256 random bits; creating the same key again does nothing.

        Raises:
            InvalidOption: the name is empty, too long or not printable, the expiry is in the past by the
                store's clock, or the token has not the form of one.
            Conflict: another key has this id.
        """
        if not 0 < len(name) <= MAX_NAME_CHARS or not name.isprintable():
            raise InvalidOption(f"a key's name is 1 to {MAX_NAME_CHARS} printable characters")
        now = self._store.now()
        if expires is not None and expires <= now:
            raise InvalidOption("the key would be expired from the start")
        parts = (secrets.token_hex(6), secrets.token_hex(32)) if token is None else parse_token(token)
        if parts is None:
            raise InvalidOption("a token is ffx_, 12 characters of 0-9 and a-f, _ and 64 more of them")
        key_id, secret = parts
        until = None if expires is None else _text(expires)
        key = ApiKey(key_id, name, grant, _hash(secret), _text(now), until)
        record = {**key.to_mapping(), "sha256": key.sha256}
        del (
            record["key_id"],
            record["revoked"],
        )  # the first is the object's name, the second an object of its own
        if not self._store.put_new(_key(key_id, _RECORD), record_json(record)):
            there = None if token is None else self._record(key_id)
            if there is None or (there.name, there.grant, there.sha256) != (name, grant, key.sha256):
                raise Conflict(f"a key {key_id} exists already: try again")
            key = there
        return key, f"ffx_{key_id}_{secret}"

    def revoke(self, key_id: str) -> None:
        """Revoke a key for good. Revoking it again does nothing.

        Raises:
            NotFound: no such key.
        """
        if not self._store.exists(_key(key_id, _RECORD)):
            raise NotFound(f"no key {key_id}")
        self._store.put_new(_key(key_id, _REVOKED), b"")

    def find(self, key_id: str) -> ApiKey | None:
        """One key that is not revoked; None if there is none, or its record is damaged."""
        key = self._read.get(key_id) or self._record(key_id)
        if key is None or self._store.exists(_key(key_id, _REVOKED)):
            return None
        self._read[key_id] = key
        return key

    def all(self) -> tuple[list[ApiKey], list[str]]:
        """All keys, oldest first, and the ids of keys with damaged records.

        One listing, and one read for each key that was not read before.
        """
        names = {key.rsplit("/", 1)[-1] for key in self._store.list(_FOLDER)}
        ids = sorted(
            name.removesuffix(_RECORD)
            for name in names
            if name.endswith(_RECORD) and _KEY_ID.fullmatch(name.removesuffix(_RECORD))
        )
        unread = [key_id for key_id in ids if key_id not in self._read]
        for key_id, key in read_each(unread, self._record).items():
            if key is not None:
                self._read[key_id] = key
        found = [
            replace(self._read[key_id], revoked=f"{key_id}{_REVOKED}" in names)
            for key_id in ids
            if key_id in self._read
        ]
        bad = [key_id for key_id in ids if key_id not in self._read]
        return sorted(found, key=lambda key: (key.created_time, key.key_id)), bad

    def _record(self, key_id: str) -> ApiKey | None:
        """Read a key's record. Returns None if it was removed meanwhile or is damaged."""
        try:
            return read_record(
                self._store, _key(key_id, _RECORD), RecordKind.API_KEY, lambda found: parse_key(key_id, found)
            )
        except (NotFound, UnreadableRecord):
            return None


def parse_token(token: str) -> tuple[str, str] | None:
    """Key id and secret of a token, or None if it has not the form of one."""
    match = API_KEY.fullmatch(token)
    return None if match is None else (match[1], match[2])


def parse_key(key_id: str, record: Mapping[str, Any]) -> ApiKey:
    """Parse the record of a key.

    Raises:
        ValueError, KeyError, TypeError, InvalidOption: it is not the record of a key.
    """
    created, expires = text_of(record, "created_time"), record["expires_time"]
    if any(datetime.fromisoformat(time).tzinfo is None for time in (created, expires) if time is not None):
        raise ValueError("a time has no zone")
    sha256 = text_of(record, "sha256")
    if not sha256.isascii():
        raise ValueError("the hash is not hex")
    grant = Grant.parse(texts_of(record, "scopes"), texts_of(record, "maps"))
    return ApiKey(key_id, text_of(record, "name"), grant, sha256, created, expires)


def _key(key_id: str, ending: str) -> str:
    if not _KEY_ID.fullmatch(key_id):
        raise InvalidOption(f"a key id is 12 characters of 0-9 and a-f, not {key_id[:20]!r}")
    return f"{_FOLDER}/{key_id}{ending}"


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def _text(time: datetime) -> str:
    return time.astimezone(timezone.utc).isoformat(timespec="seconds")

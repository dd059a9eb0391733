"""API keys in an object store: who may do what, each secret only as its hash.

    keys/<key id>.json      created once: name, grant, sha256 of the secret, times
    keys/<key id>.revoked   there: the key is worth nothing any more

A key is ``ffx_<key id>_<secret>``, 12 and 64 lower-case hex characters, so that scanners of repositories and
logs can tell one. The secret is 256 random bits: nobody guesses it from its SHA-256, so the slow, salted hash
that a password needs (bcrypt, argon2) would only slow every request down. Whoever can write the store can
make keys, as they could put false maps there.
"""

from __future__ import annotations

import hashlib
import hmac
import json
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime, timezone
from typing import Any

from ..errors import Conflict, InvalidOption, NotFound, UnreadableRecord
from ..store.json_record import RecordKind, read_each, read_record, text_of, texts_of
from ..store.store import Store
from .permissions import Grant

_FOLDER = "keys"
_KEY_ID = re.compile(r"[0-9a-f]{12}")
_TOKEN = re.compile(r"ffx_([0-9a-f]{12})_([0-9a-f]{64})")
_RECORD, _REVOKED = ".json", ".revoked"
MAX_NAME_CHARS = 100


@dataclass(frozen=True)
class ApiKey:
    """One key, without its secret.

    Attributes:
        name: for people.
        sha256: of the secret, hex.
        created_time, expires_time: UTC, ISO 8601; no expiry: None.
        revoked: it is worth nothing any more.
    """

    key_id: str
    name: str
    grant: Grant
    sha256: str
    created_time: str
    expires_time: str | None = None
    revoked: bool = False

    def matches(self, secret: str) -> bool:
        """Whether that is its secret, in a time that tells nothing."""
        return hmac.compare_digest(self.sha256, _hash(secret))

    def is_expired(self, now: datetime) -> bool:
        return self.expires_time is not None and now >= datetime.fromisoformat(self.expires_time)

    def to_mapping(self) -> dict[str, Any]:
        """What people and programs are shown: no hash."""
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
    """The keys of a store. Thread-safe. Every method raises StoreError as the store does."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._read: dict[str, ApiKey] = {}  # records never change; those that cannot be read are tried again

    def create(
        self, name: str, grant: Grant, expires: datetime | None = None, token: str | None = None
    ) -> tuple[ApiKey, str]:
        """A new key, and its token: the one time that the secret is seen.

        Args:
            expires: with a time zone.
            token: that was made elsewhere, of 256 random bits; to create the same key once more does nothing.

        Raises:
            InvalidOption: the name is empty, long or not printable, it would expire in the past, or the token
                does not have the form of one.
            Conflict: there is another key of that id.
        """
        if not 0 < len(name) <= MAX_NAME_CHARS or not name.isprintable():
            raise InvalidOption(f"a key's name is 1 to {MAX_NAME_CHARS} printable characters")
        now = datetime.now(timezone.utc)
        if expires is not None and expires <= now:
            raise InvalidOption("the key would have expired already")
        parts = (secrets.token_hex(6), secrets.token_hex(32)) if token is None else parse_token(token)
        if parts is None:
            raise InvalidOption("a token is ffx_, 12 characters of 0-9 and a-f, _ and 64 more of them")
        key_id, secret = parts
        until = None if expires is None else _text(expires)
        key = ApiKey(key_id, name, grant, _hash(secret), _text(now), until)
        record = {**key.to_mapping(), "sha256": key.sha256}
        del record["key_id"], record["revoked"]  # the object's name, and an object of its own
        if not self._store.put_new(_key(key_id, _RECORD), json.dumps(record, sort_keys=True).encode()):
            there = None if token is None else self._record(key_id)
            if there is None or (there.name, there.grant, there.sha256) != (name, grant, key.sha256):
                raise Conflict(f"there is a key {key_id} already: try again")
            key = there
        return key, f"ffx_{key_id}_{secret}"

    def revoke(self, key_id: str) -> None:
        """Takes a key back, for good. Once more does nothing.

        Raises:
            NotFound: no such key.
        """
        if not self._store.exists(_key(key_id, _RECORD)):
            raise NotFound(f"no key {key_id}")
        self._store.put_new(_key(key_id, _REVOKED), b"")

    def all(self) -> tuple[list[ApiKey], list[str]]:
        """Every key, oldest first, and the ids of those whose record cannot be read.

        One listing, and a read for each key that was not read before.
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
        """None when it was removed since, or is no record."""
        try:
            return read_record(
                self._store, _key(key_id, _RECORD), RecordKind.API_KEY, lambda found: parse_key(key_id, found)
            )
        except (NotFound, UnreadableRecord):
            return None


def parse_token(token: str) -> tuple[str, str] | None:
    """Key id and secret of a token; None when it does not have the form of one."""
    match = _TOKEN.fullmatch(token)
    return None if match is None else (match[1], match[2])


def parse_key(key_id: str, record: Mapping[str, Any]) -> ApiKey:
    """
    Raises:
        ValueError, KeyError, TypeError, InvalidOption: not a key's record.
    """
    created, expires = text_of(record, "created_time"), record["expires_time"]
    if any(datetime.fromisoformat(time).tzinfo is None for time in (created, expires) if time is not None):
        raise ValueError("a time has no zone")
    sha256 = text_of(record, "sha256")
    if not sha256.isascii():
        raise ValueError("the hash is none")
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

"""URL of an object store, checked before anything is opened.

    /data/maps    file:///data/maps                     a directory
    memory://                                           this process only, for tests
    s3://bucket/prefix?endpoint=https://host&region=eu  S3, or another server with its protocol
    gs://bucket/prefix                                  Google Cloud Storage
    az://container/prefix?account_name=name             Azure Blob Storage

The URL is logged and shown, so it contains no secrets. They come from the environment under the cloud's
own names (AWS_ACCESS_KEY_ID, GOOGLE_APPLICATION_CREDENTIALS, AZURE_STORAGE_ACCOUNT_KEY, ...).
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import parse_qsl, unquote, urlsplit

from ..errors import InvalidOption

SCHEMES = {"file": "file", "memory": "memory", "s3": "s3", "s3a": "s3", "gs": "gs", "gcs": "gs", "az": "az"}
_TEXT_OPTIONS = {
    "file": frozenset[str](),
    "memory": frozenset[str](),
    "s3": frozenset({"endpoint", "region"}),
    "gs": frozenset({"endpoint"}),
    "az": frozenset({"endpoint", "account_name"}),
}
_FLAG_OPTIONS = {
    "file": frozenset[str](),
    "memory": frozenset[str](),
    "s3": frozenset({"allow_http", "virtual_hosted_style_request", "skip_signature"}),
    "gs": frozenset({"allow_http", "skip_signature"}),
    "az": frozenset({"allow_http", "skip_signature", "use_emulator"}),
}
# Variables that obstore reads where the URL has no such parameter: which server it is, and whose account.
_WHERE_VARIABLES: dict[str, dict[str, tuple[str, ...]]] = {
    "file": {},
    "memory": {},
    "s3": {"endpoint": ("AWS_ENDPOINT_URL_S3", "AWS_ENDPOINT_URL", "AWS_ENDPOINT")},
    "gs": {"endpoint": ("GOOGLE_BASE_URL",)},
    "az": {
        "endpoint": ("AZURE_STORAGE_ENDPOINT", "AZURE_ENDPOINT"),
        "account_name": ("AZURE_STORAGE_ACCOUNT_NAME",),
        "use_emulator": ("AZURE_STORAGE_USE_EMULATOR",),
    },
}
_FLAGS = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True)
class StoreUrl:
    """Checked URL of a store.

    Attributes:
        scheme: one of file, memory, s3, gs, az.
        bucket: bucket or container; empty for file and memory.
        prefix: directory of a file store, otherwise the key prefix within the bucket.
        texts, flags: query parameters.
    """

    scheme: str
    bucket: str = ""
    prefix: str = ""
    texts: Mapping[str, str] = field(default_factory=dict)
    flags: Mapping[str, bool] = field(default_factory=dict)

    @classmethod
    def parse(cls, url: str) -> StoreUrl:
        """Parse a URL or a plain path.

        Raises:
            InvalidOption: the URL has an unknown scheme or parameter, no bucket, or a secret in it.
        """
        if "://" not in url:
            if not url:
                raise InvalidOption("the store URL is empty")
            return cls("file", prefix=str(Path(url).expanduser().absolute()))
        parts = urlsplit(url)
        scheme = SCHEMES.get(parts.scheme.lower())
        if scheme is None:
            raise InvalidOption(f"no store of scheme {parts.scheme!r}; there are {', '.join(SCHEMES)}")
        if "@" in parts.netloc:
            raise InvalidOption("a store URL must not contain secrets: give them in the environment")
        texts, flags = _options(scheme, parts.query)
        if scheme == "file":
            if parts.netloc not in ("", "localhost") or not parts.path.startswith("/"):
                raise InvalidOption("a file store is file:///absolute/directory")
            return cls("file", prefix=str(Path(unquote(parts.path))))
        if scheme == "memory":
            return cls("memory")
        if not parts.netloc:
            raise InvalidOption(f"{scheme}:// needs a bucket")
        return cls(scheme, parts.netloc, unquote(parts.path).strip("/"), texts, flags)

    def identity(self, environment: Mapping[str, str] = os.environ) -> str:
        """Canonical text of which store this is: the same for every way to write its URL.

        Args:
            environment: variables; those that name a server or an account are part of it.
        """
        given = {**self.texts, **{name: str(value).lower() for name, value in self.flags.items()}}
        where = {}
        for name, variables in _WHERE_VARIABLES[self.scheme].items():
            named = [given.get(name), *(environment.get(variable) for variable in variables)]
            where[name] = next((value for value in named if value), "").rstrip("/")
        # the same behind a symbolic link
        place = str(Path(self.prefix).resolve()) if self.scheme == "file" else self.prefix
        return json.dumps([self.scheme, self.bucket, place, where], sort_keys=True)


def _options(scheme: str, query: str) -> tuple[dict[str, str], dict[str, bool]]:
    texts: dict[str, str] = {}
    flags: dict[str, bool] = {}
    for name, value in parse_qsl(query, keep_blank_values=True):
        if name in _TEXT_OPTIONS[scheme]:
            texts[name] = value
        elif name in _FLAG_OPTIONS[scheme]:
            if value.lower() not in _FLAGS:
                raise InvalidOption(f"{name} is true or false, not {value!r}")
            flags[name] = _FLAGS[value.lower()]
        elif any(word in name.lower() for word in ("key", "secret", "token", "password")):
            # the value stays out of the message: it is the secret
            raise InvalidOption(f"{name}: a store URL must not contain secrets: give them in the environment")
        else:
            raise InvalidOption(f"a {scheme} store has no parameter {name!r}")
    return texts, flags

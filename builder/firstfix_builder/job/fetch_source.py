"""Brings what a build request names to the local disk."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from firstfix.builds.source_policy import check_source_url
from firstfix.catalog.sources import source_key
from firstfix.errors import BuildFailed, InvalidOption, NotFound, StoreError, TooLarge
from firstfix.store.sha256 import sha256_of
from firstfix.store.store import Store
from firstfix.store.url import StoreUrl

from .fetch_http import fetch_http

DEFAULT_MAX_BYTES = 32 << 30
_ODD = re.compile(r"[^A-Za-z0-9._-]")


@dataclass(frozen=True)
class SourcePolicy:
    """What a request may name.

    Attributes:
        max_bytes: of one file.
        roots: folders that ``file://`` URLs may point into; requests come over the network, so none
            by default.
        urls: prefixes of http and https URLs that are fetched; none by default, as a worker that fetches
            anything is a way into the network behind it.
    """

    max_bytes: int = DEFAULT_MAX_BYTES
    roots: tuple[Path, ...] = ()
    urls: tuple[str, ...] = ()


def fetch_source(
    store_url: str,
    store: Store,
    map_id: str,
    build_id: str,
    named: Mapping[str, Any],
    file_name: str,
    folder: Path,
    policy: SourcePolicy | None = None,
    told: Callable[[float], None] = lambda done: None,
) -> Path:
    """A local file with the content that a request names, under a name with the same ending.

    Args:
        named: {"key": an upload of this map} or {"url": an object elsewhere}.
        folder: where it goes; what an earlier run brought there whole is used again.
        told: called as it arrives with the share that is done, 0..1.

    Raises:
        InvalidOption: a key of another map, a URL that the policy or the store forbids.
        NotFound: there is no such object.
        BuildFailed: the store of a URL does not answer, or refuses.
        TooLarge: over the policy's limit.
    """
    policy = policy or SourcePolicy()
    if "key" in named:
        key = str(named["key"])
        sha256 = key.rsplit("/", 1)[-1]
        if key != source_key(map_id, sha256):
            raise InvalidOption(f"{key[:200]!r} is not a source of map {map_id}")
        path = folder / sha256 / _safe_name(file_name)
        if path.exists() and sha256_of(path) == sha256:
            return path
        try:
            _download(store, key, path, policy.max_bytes, told)
        except NotFound:  # collected as the build was asked for: then there is a copy for it
            _download(store, source_key(map_id, sha256, build_id), path, policy.max_bytes, told)
        return path
    url = str(named.get("url", ""))
    path = folder / hashlib.sha256(url.encode()).hexdigest() / _safe_name(file_name)
    if urlsplit(url).scheme in ("http", "https"):
        fetch_http(check_source_url(url, policy.urls), path, policy.max_bytes, told)
        return path
    where = _allowed(url, StoreUrl.parse(store_url), policy.roots)
    parent, _, name = where.prefix.rpartition("/")
    # Fetched anew in every run: unlike an upload, what stands at a URL may have changed.
    try:
        _download(Store.open_at(replace(where, prefix=parent)), name, path, policy.max_bytes, told)
    except StoreError as error:  # a stranger's store: no fault of ours that would pass by trying again
        raise BuildFailed(f"the source's store does not give it: {error}") from None
    return path


def _download(store: Store, key: str, path: Path, max_bytes: int, told: Callable[[float], None]) -> None:
    size = store.size(key)
    if size > max_bytes:
        raise TooLarge(f"{key} has {size} bytes, the limit is {max_bytes}")
    path.parent.mkdir(parents=True, exist_ok=True)
    store.download(key, path, told)


def _allowed(url: str, own: StoreUrl, roots: Sequence[Path]) -> StoreUrl:
    """The URL with the own store's settings.

    The worker's credentials open more than the caller's: a caller must not reach another map through
    them, nor have them sent to a server of the caller's choice.
    """
    if "://" not in url:
        raise InvalidOption("the source is an upload, or a URL such as s3://bucket/map.ply")
    where = StoreUrl.parse(url)
    if where.scheme == "file":
        path = Path(where.prefix).resolve()
        if not any(path.is_relative_to(root.resolve()) for root in roots):
            raise InvalidOption("this worker reads no source from its own disk at that place")
        if not path.is_file():
            raise NotFound(f"no file {path.name} at the source's place")
        return replace(where, prefix=str(path))
    if where.scheme == "memory" or not where.prefix:
        raise InvalidOption("the source's URL names no object")
    if where.scheme == own.scheme:
        inside = not own.prefix or f"{where.prefix}/".startswith(f"{own.prefix}/")
        if where.bucket == own.bucket and inside:
            raise InvalidOption("the source's URL points into the store of maps: name an upload by its key")
        settings = {**own.texts, **own.flags}
    else:
        settings = {}
    for name, value in {**where.texts, **where.flags}.items():
        if name != "region" and settings.get(name) != value:
            raise InvalidOption(
                f"{name} of a source's URL is set where the worker is started, not in the URL"
            )
    if where.scheme != own.scheme:
        return where
    return replace(where, texts={**own.texts, **where.texts}, flags=own.flags)


def _safe_name(file_name: str) -> str:
    """The last part of a name from outside: readers go by its ending."""
    name = _ODD.sub("_", file_name.replace("\\", "/").rsplit("/", 1)[-1])[-120:].lstrip(".")
    return name or "source"

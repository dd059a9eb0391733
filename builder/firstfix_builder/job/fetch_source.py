"""Fetches the files of a build request to the local disk."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from firstfix.builds.options import BuildOptions
from firstfix.builds.source_policy import check_source_url
from firstfix.catalog.sources import source_key
from firstfix.errors import BuildFailed, InvalidOption, NotFound, StoreError, TooLarge
from firstfix.store.sha256 import sha256_of
from firstfix.store.store import Store
from firstfix.store.url import StoreUrl

_ODD = re.compile(r"[^A-Za-z0-9._-]")


@dataclass(frozen=True)
class SourceFetch:
    """Fetches the files that the request of one build names.

    The files go to ``<work>/sources``. A complete file of an earlier run is used again.

    Attributes:
        store: the store of maps.
    """

    options: BuildOptions
    store: Store
    map_id: str

    def of_request(
        self, request: Mapping[str, Any], on_progress: Callable[[float], None] = lambda done: None
    ) -> dict[str, Path]:
        """The local files by role: ``source``, and ``trajectory`` if the request has one.

        Args:
            on_progress: called with the share of all files that has arrived, 0..1.

        Raises:
            FirstfixError: as ``fetch``.
        """
        source, trajectory = json_object(request, "source"), json_object(request, "trajectory")
        named = {"source": (source, str(request.get("file_name") or _url_ending(source)))}
        if trajectory:
            named["trajectory"] = (trajectory, str(trajectory.get("file_name") or _url_ending(trajectory)))
        return {
            role: self.fetch(where, file_name, _share(on_progress, number, len(named)))
            for number, (role, (where, file_name)) in enumerate(named.items())
        }

    def fetch(
        self,
        named: Mapping[str, Any],
        file_name: str,
        on_progress: Callable[[float], None] = lambda done: None,
    ) -> Path:
        """A local file with the content that a request names, under a name with the same ending.

        Args:
            named: {"key": an upload of this map} or {"url": an object elsewhere}.
            on_progress: called with the share that has arrived, 0..1.

        Raises:
            InvalidOption: a key of another map, or a URL that the options or the store forbid.
            NotFound: there is no such object.
            BuildFailed: the store of a URL does not answer, or refuses.
            TooLarge: over the limit.
        """
        folder, max_bytes = self.options.work / "sources", self.options.max_source_bytes
        if "key" in named:
            key = str(named["key"])
            sha256 = key.rsplit("/", 1)[-1]
            if key != source_key(self.map_id, sha256):
                raise InvalidOption(f"{key[:200]!r} is not a source of map {self.map_id}")
            path = folder / sha256 / _safe_name(file_name)
            if path.exists() and sha256_of(path) == sha256:
                return path
            try:
                _download(self.store, key, path, max_bytes, on_progress)
            except NotFound:  # collected as the build was asked for: then there is a copy for it
                copy = source_key(self.map_id, sha256, self.options.build_id)
                _download(self.store, copy, path, max_bytes, on_progress)
            return path
        url = str(named.get("url", ""))
        path = folder / hashlib.sha256(url.encode()).hexdigest() / _safe_name(file_name)
        if urlsplit(url).scheme in ("http", "https"):
            from .fetch_http import fetch_http  # imported late: httpx is a fifth of the start of each build

            fetch_http(check_source_url(url, self.options.source_urls), path, max_bytes, on_progress)
            return path
        where = _allowed(url, StoreUrl.parse(self.options.store), self.options.source_roots)
        parent, _, name = where.prefix.rpartition("/")
        # Fetched anew in every run: unlike an upload, the object at a URL may have changed.
        try:
            _download(Store.open_at(replace(where, prefix=parent)), name, path, max_bytes, on_progress)
        except StoreError as error:  # not the store of maps: another attempt would not help
            raise BuildFailed(f"the source cannot be fetched from its store: {error}") from None
        return path


def json_object(request: Mapping[str, Any], name: str) -> dict[str, Any]:
    """A JSON object of the request, empty if there is none.

    Raises:
        InvalidOption: it is not an object.
    """
    value = request.get(name) or {}
    if not isinstance(value, dict):
        raise InvalidOption(f"{name} of the request is not a JSON object")
    return value


def _share(on_progress: Callable[[float], None], number: int, count: int) -> Callable[[float], None]:
    """Progress of one of several files, as a share of them all."""
    return lambda done: on_progress((number + done) / count)


def _url_ending(named: Mapping[str, Any]) -> str:
    """File name of a source that has only a URL."""
    return urlsplit(str(named.get("url", ""))).path.rsplit("/", 1)[-1]


def _download(
    store: Store, key: str, path: Path, max_bytes: int, on_progress: Callable[[float], None]
) -> None:
    size = store.size(key)
    if size > max_bytes:
        raise TooLarge(f"{key} has {size} bytes, the limit is {max_bytes}")
    path.parent.mkdir(parents=True, exist_ok=True)
    store.download(key, path, on_progress)


def _allowed(url: str, own: StoreUrl, roots: Sequence[Path]) -> StoreUrl:
    """The URL with the settings of the worker's own store, if it is allowed.

    The worker's credentials allow more than those of the caller. So a caller must not reach another map
    through them, and they must not be sent to a server that the caller chooses.
    """
    if "://" not in url:
        raise InvalidOption("the source is an upload, or a URL such as s3://bucket/map.ply")
    where = StoreUrl.parse(url)
    if where.scheme == "file":
        path = Path(where.prefix).resolve()
        if not any(path.is_relative_to(root.resolve()) for root in roots):
            raise InvalidOption("this worker may not read a source from that place of its disk")
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
    """Last part of a file name from outside, whose ending tells the format."""
    name = _ODD.sub("_", file_name.replace("\\", "/").rsplit("/", 1)[-1])[-120:].lstrip(".")
    return name or "source"

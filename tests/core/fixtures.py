"""Fixtures of several packages of the core: stores, versions of maps, races, and limits of memory."""

from __future__ import annotations

import threading
import tracemalloc
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.store.store import Store


@pytest.fixture
def store() -> Store:
    return Store.open("memory://")


@pytest.fixture
def any_store(any_store_url: str) -> Store:
    """An empty store: the test runs on each kind."""
    return Store.open(any_store_url)


@pytest.fixture
def catalog(store: Store) -> Catalog:
    return Catalog(store)


@pytest.fixture
def any_catalog(any_store: Store) -> Catalog:
    return Catalog(any_store)


@pytest.fixture
def made(tmp_path: Path) -> tuple[Path, Manifest]:
    """The folder and the manifest of a version that was not published yet."""
    return tmp_path / "made", make_version(tmp_path / "made", files={"z.npy": b"more of it"})


def make_version(
    folder: Path, content: bytes = b"content", files: Mapping[str, bytes] | None = None, **values: Any
) -> Manifest:
    """Write the files of a version, ``a.npy`` with this content among them, and return its manifest."""
    for name, data in {"a.npy": content, **(files or {})}.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(data)
    return Manifest.for_directory(folder, **values)


def publish(
    catalog: Catalog, scratch: Path, content: str, map_id: str = "hall", *, build_id: str = "", **values: Any
) -> str:
    """Publish a version that is made in ``scratch / content``, and return its name."""
    manifest = make_version(scratch / content, content.encode(), **values)
    return catalog.publish(map_id, scratch / content, manifest, build_id=build_id)


def recording(url: str, *names: str) -> tuple[Store, list[tuple[str, str]]]:
    """Open a store that records its calls of these methods: name and key."""
    calls: list[tuple[str, str]] = []

    def recorded(name: str) -> Any:
        def call(self: Store, key: str = "", *more: Any, **how: Any) -> Any:
            calls.append((name, key))
            return getattr(Store, name)(self, key, *more, **how)

        return call

    kind = type("RecordingStore", (Store,), {name: recorded(name) for name in names})
    return kind.open(url), calls


def at_once(count: int, work: Callable[[int], Any]) -> list[Any]:
    """Call it in so many threads, which begin together, with their numbers. Returns the results in order."""
    start = threading.Barrier(count)

    def run(number: int) -> Any:
        start.wait()
        return work(number)

    with ThreadPoolExecutor(count) as threads:
        return list(threads.map(run, range(count)))


@contextmanager
def in_memory_of(limit_bytes: int) -> Iterator[None]:
    """Check that the block takes less memory than this."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < limit_bytes
    finally:
        tracemalloc.stop()

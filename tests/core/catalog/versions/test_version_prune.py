"""Pruning: the least recently used version is removed, never one that a process uses."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.versions.folder_lock import FolderLock, exclusive_lock
from firstfix.catalog.versions.prune import ABANDONED_S, prune
from firstfix.store.store import Store
from tests.core.fixtures import make_version

BYTES = 1000


class Place:
    """A store with versions to fetch and a cache folder."""

    def __init__(self, folder: Path, url: str = "memory://") -> None:
        self.catalog = Catalog(Store.open(url))
        self.cache = folder / "cache"
        self.made = folder / "made"

    def fetch(self, label: int) -> Path:
        manifest = make_version(self.made / str(label), b"%04d" % label * (BYTES // 4))
        version = self.catalog.publish("hall", self.made / str(label), manifest)
        return self.catalog.fetch_version("hall", version, self.cache)

    def used(self, version: str, seconds_ago: float) -> None:
        then = time.time() - seconds_ago
        os.utime(self.cache / f".{version}.verified", (then, then))


@pytest.fixture
def place(tmp_path: Path) -> Place:
    return Place(tmp_path)


def test_the_version_used_longest_ago_is_pruned_first(place: Place):
    folders = [place.fetch(k) for k in range(4)]
    for k, folder in enumerate(folders):
        place.used(folder.name, 100 - k)
    place.fetch(0)  # used again just now
    assert prune(place.cache, 4 * BYTES) == []
    assert prune(place.cache, 2 * BYTES) == [folders[1].name, folders[2].name]
    assert {path.name.strip(".").split(".")[0] for path in place.cache.iterdir()} == {
        folders[0].name,
        folders[3].name,
    }
    assert place.fetch(1).is_dir(), "and comes back when it is asked for"


def test_a_held_version_stays_until_it_is_released(place: Place):
    first, second = place.fetch(1), place.fetch(2)
    held, also = FolderLock(first), FolderLock(first)
    assert prune(place.cache, 0) == [second.name]
    held.close()
    assert prune(place.cache, 0) == []
    also.close()
    third = place.fetch(3)
    with exclusive_lock(place.cache / f".{third.name}.lock"):
        assert prune(place.cache, 0) == [first.name], "the other one is being fetched"
    assert third.is_dir()
    with pytest.raises(FileNotFoundError):
        FolderLock(first)


def test_a_version_held_by_another_process_stays_until_it_is_killed(place: Place):
    folder = place.fetch(1)
    code = (
        "import signal, sys; from pathlib import Path\n"
        "from firstfix.catalog.versions.folder_lock import FolderLock\n"
        "held = FolderLock(Path(sys.argv[1])); print('held', flush=True); signal.pause()"
    )
    holder = subprocess.Popen([sys.executable, "-c", code, str(folder)], stdout=subprocess.PIPE)
    try:
        assert holder.stdout is not None
        assert holder.stdout.readline() == b"held\n"
        assert prune(place.cache, 0) == []
    finally:
        holder.kill()
        holder.wait()
    assert prune(place.cache, 0) == [folder.name]


def test_leftovers_of_killed_processes_go(place: Place):
    version = "a" * 64
    kept = place.fetch(1)
    young, old = place.cache / f".{'b' * 64}.part", place.cache / f".{version}.part"
    for part in (young, old):
        part.mkdir()
        (part / "a.npy").write_bytes(b"half")
    long_ago = time.time() - ABANDONED_S - 10
    os.utime(old, (long_ago, long_ago))
    (place.cache / f".{version}.{'0' * 32}.old").mkdir()
    (place.cache / f".{version}.lock").touch()
    (place.cache / "notes.txt").write_text("not ours")
    assert prune(place.cache, 1 << 30) == []
    left = {path.name for path in place.cache.iterdir()}
    assert not [name for name in left if version in name]
    assert {kept.name, young.name, "notes.txt"} <= left


def test_markers_of_a_file_store_go_with_their_versions(tmp_path: Path):
    place = Place(tmp_path, f"file://{tmp_path / 'store'}")
    folder = place.fetch(1)
    assert "store" in str(folder)
    prune(place.cache, 0)
    assert (place.cache / f".{folder.name}.verified").exists(), "its version is still there"
    place.catalog.retire("hall", folder.name, force=True)
    assert place.catalog.collect_garbage("hall", older_than_s=-5)
    prune(place.cache, 0)
    assert list(place.cache.iterdir()) == []


def test_fetching_holding_and_pruning_at_once_never_shows_half_a_version(place: Place):
    folders = [place.fetch(k) for k in range(3)]
    wholes = {folder.name: (folder / "a.npy").read_bytes() for folder in folders}
    end = threading.Event()

    def prunes() -> int:
        removed = 0
        while not end.is_set():
            removed += len(prune(place.cache, 0))
        return removed

    def uses(name: str) -> int:
        good = 0
        while good < 30:
            try:
                held = FolderLock(place.catalog.fetch_version("hall", name, place.cache))
            except FileNotFoundError:
                continue
            assert (held.path / "a.npy").read_bytes() == wholes[name]
            held.close()
            good += 1
        return good

    with ThreadPoolExecutor(6) as threads:
        pruning = threads.submit(prunes)
        try:
            assert sum(threads.map(uses, [*wholes, *list(wholes)[:2]])) == 150
        finally:
            end.set()
        assert pruning.result() > 0

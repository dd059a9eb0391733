"""Objects of a file store after a power cut: on a real file system image, and by the order of its calls."""

from __future__ import annotations

import errno
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from firstfix.errors import OutOfSpace, StoreError, StoreUnavailable, StoreUnsafe
from firstfix.store import durable_files
from firstfix.store.durable_files import DurableFiles
from firstfix.store.store import Store
from tests.disk_image import DiskImage, why_no_images

WAIT_S = 60.0
CONTENT = bytes(range(256)) * 1000
KEY = "maps/hall/log/000001.json"


WRITERS = {
    "put_new": lambda store, source: store.put_new(KEY, CONTENT),
    "put": lambda store, source: store.put(KEY, CONTENT),
    "put_file": lambda store, source: store.put_file(KEY, source),
    "put_pieces": lambda store, source: store.put_pieces(
        KEY, (CONTENT[i : i + 999] for i in range(0, 256000, 999))
    ),
}
each_writer = pytest.mark.parametrize("write", WRITERS.values(), ids=WRITERS)


@pytest.fixture(scope="module")
def images() -> None:
    if why := why_no_images():
        pytest.skip(why)


@pytest.fixture
def source(tmp_path: Path) -> Path:
    path = tmp_path / "source"
    path.write_bytes(CONTENT)
    return path


class HeldSyncs:
    """Makes every fsync of a thread wait until it is released."""

    def __init__(self, write: Callable[[], None], monkeypatch: pytest.MonkeyPatch) -> None:
        self.fsync = os.fsync
        self._reached, self._go = threading.Semaphore(0), threading.Semaphore(0)
        self._thread = threading.Thread(target=self._run, args=(write,))
        self.failed: BaseException | None = None
        self.done = False
        monkeypatch.setattr(os, "fsync", self._held)

    def __iter__(self) -> Iterator[None]:
        """Yields once while each sync waits, and once at the end."""
        self._thread.start()
        while not self.done:
            assert self._reached.acquire(timeout=WAIT_S)
            yield
            self._go.release()
        self._thread.join()

    def _run(self, write: Callable[[], None]) -> None:
        try:
            write()
        except BaseException as error:
            self.failed = error
        self.done = True
        self._reached.release()

    def _held(self, handle: int) -> None:
        if threading.current_thread() is self._thread:
            self._reached.release()
            assert self._go.acquire(timeout=WAIT_S)
        self.fsync(handle)


@each_writer
def test_a_power_cut_at_any_point_of_a_put_leaves_all_or_nothing(
    images: None, tmp_path: Path, source: Path, write: Any, monkeypatch: pytest.MonkeyPatch
):
    found: list[bytes | None] = []
    with DiskImage.make(tmp_path / "image", tmp_path / "disk", size_bytes=16 << 20) as disk:
        store = Store.open(f"file://{disk.mount_point / 'store'}")
        other = (disk.mount_point / "other").open("wb")
        held = HeldSyncs(lambda: write(store, source), monkeypatch)
        for _ in held:
            other.write(b"of another writer")
            other.flush()
            held.fsync(other.fileno())  # brings the journal to disk, with the names of all files
            with disk.copy_to(tmp_path / "copy", tmp_path / "copied") as copy:
                path = copy.mount_point / "store" / KEY
                found.append(path.read_bytes() if path.exists() else None)
        other.close()
        assert held.failed is None
    assert len(found) > 2, "no sync was held"
    assert set(found[:-1]) <= {None, CONTENT}, [None if one is None else len(one) for one in found]
    assert found[-1] == CONTENT, "what was acknowledged is lost"


def test_a_deleted_object_does_not_come_back_after_a_power_cut(images: None, tmp_path: Path):
    with DiskImage.make(tmp_path / "image", tmp_path / "disk", size_bytes=16 << 20) as disk:
        store = Store.open(f"file://{disk.mount_point / 'store'}")
        gone = ("keys/one", "builds/b1/attempts/1")
        for key in (*gone, "builds/b1/request.json"):
            store.put(key, b"x")
        for key in gone:
            store.delete(key)
        with disk.copy_to(tmp_path / "copy", tmp_path / "copied") as copy:
            assert Store.open(f"file://{copy.mount_point / 'store'}").list() == ["builds/b1/request.json"]


class Calls:
    """File system calls that determine what is on disk, in order, with file names."""

    def __init__(self, root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self.made: list[tuple[str, str]] = []
        self._root = root
        for module, name, at in ((os, "fsync", 0), (os, "link", 1), (Path, "replace", 1), (os, "mkdir", 0)):
            monkeypatch.setattr(module, name, self._told(name, getattr(module, name), at))

    def _told(self, name: str, call: Callable[..., Any], at: int) -> Callable[..., Any]:
        def tell(*args: Any, **kwargs: Any) -> Any:
            where = Path(f"/proc/self/fd/{args[0]}").readlink() if name == "fsync" else Path(args[at])
            if where.is_relative_to(self._root):
                path = where.relative_to(self._root).as_posix()
                self.made.append((name, "part" if "#" in path else path))
            return call(*args, **kwargs)

        return tell


@each_writer
def test_a_file_has_its_name_after_its_bytes_are_on_disk(tmp_path, source: Path, write: Any, monkeypatch):
    root = tmp_path / "store"
    store = Store.open(f"file://{root}")
    calls = Calls(root, monkeypatch)
    write(store, source)
    name = ("link" if write is WRITERS["put_new"] else "replace", KEY)
    folders = {"maps", "maps/hall", "maps/hall/log"}
    made = calls.made
    assert {path for call, path in made if call == "mkdir"} == folders
    assert made.index(("fsync", "part")) < made.index(name)
    assert made[-1] == ("fsync", "maps/hall/log"), "its name is on disk"
    for folder in (".", "maps", "maps/hall"):
        assert ("fsync", folder) in made, "a new folder's entry is on disk"


@contextmanager
def failing(monkeypatch: pytest.MonkeyPatch, name: str, number: int) -> Iterator[None]:
    call, failing_thread = getattr(os, name), threading.get_ident()

    def fail(*given: Any, **named: Any) -> Any:
        if threading.get_ident() != failing_thread:  # services of other tests may run in threads of theirs
            return call(*given, **named)
        raise OSError(number, os.strerror(number))

    with monkeypatch.context() as patch:
        patch.setattr(os, name, fail)
        yield


@each_writer
@pytest.mark.parametrize(
    ("number", "error"),
    [(errno.ENOSPC, OutOfSpace), (errno.EROFS, StoreUnavailable), (errno.EACCES, StoreError)],
)
def test_a_failed_put_leaves_nothing(tmp_path, source, write, number, error, monkeypatch):
    store = Store.open(f"file://{tmp_path / 'store'}")
    with failing(monkeypatch, "fsync", number), pytest.raises(error):
        write(store, source)
    assert not [path for path in (tmp_path / "store").rglob("*") if path.is_file()]
    write(store, source)
    assert store.get(KEY) == CONTENT


def test_without_hard_links_a_rename_that_does_not_replace_decides(tmp_path, monkeypatch):
    store = Store.open(f"file://{tmp_path}")
    with failing(monkeypatch, "link", errno.EPERM):
        store.probe()
        assert store.put_new("k", b"first")
        assert not store.put_new("k", b"second")
        assert store.get("k") == b"first"
        monkeypatch.setattr(durable_files, "_RENAME_NOREPLACE", 1 << 30)  # EINVAL, as where it is not known
        with pytest.raises(StoreUnsafe):
            store.put_new("other", b"first")
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == ["k"]


def test_a_folder_removed_by_others_is_made_again(tmp_path: Path):
    files, others = DurableFiles(tmp_path), DurableFiles(tmp_path)
    stop = threading.Event()

    def remove() -> None:
        while not stop.is_set():
            others.removed("a/b/c/key")

    remover = threading.Thread(target=remove)
    remover.start()
    try:
        for number in range(200):
            assert files.create("a/b/c/key", (b"%d" % number,))
            (tmp_path / "a/b/c/key").unlink()
    finally:
        stop.set()
        remover.join()


def test_a_folder_removed_while_it_is_made_is_made_again(tmp_path, monkeypatch):
    files = DurableFiles(tmp_path)
    (tmp_path / "a").mkdir()
    os_mkdir, found = os.mkdir, []

    def mkdir(path, mode=0o777) -> None:
        try:
            os_mkdir(path, mode)
        except FileExistsError:
            if tmp_path in Path(path).parents:  # other threads make folders, too
                found.append(path)
                Path(path).rmdir()
            raise

    monkeypatch.setattr(os, "mkdir", mkdir)
    assert files.create("a/key", (b"1",))
    assert found == [tmp_path / "a"]
    assert (tmp_path / "a/key").read_bytes() == b"1"


def test_a_file_in_the_place_of_a_folder_is_an_error(tmp_path: Path):
    (tmp_path / "a").write_bytes(b"")
    with pytest.raises(FileExistsError):
        DurableFiles(tmp_path).create("a/key", (b"1",))


def test_leftovers_of_a_power_cut_are_removed_with_their_folders(tmp_path: Path):
    store = Store.open(f"file://{tmp_path}")
    store.put("builds/b1/request.json", b"{}")
    for left in ("builds/b2/attempts", "builds/b3", "uploads/u1/parts"):
        (tmp_path / left).mkdir(parents=True)
    (tmp_path / "builds/b3/request.json#12").write_bytes(b"")
    assert store.remove_leftovers(older_than_s=60) == []
    assert store.folders("builds") == ["b1", "b2", "b3"], "they may be in use this moment"
    assert store.remove_leftovers(older_than_s=-5) == ["builds/b3/request.json#12"]
    assert store.folders("builds") == ["b1"]
    assert store.folders("uploads") == []


def test_a_cache_is_written_without_waiting_for_the_disk(tmp_path: Path, monkeypatch):
    cache = Store.open_cache(tmp_path / "cache")

    def fsync(handle: int) -> None:
        raise AssertionError("it waits")

    monkeypatch.setattr(os, "fsync", fsync)
    assert cache.put_new("a/b", b"1")
    assert not cache.put_new("a/b", b"2")
    cache.put("a/b", b"3")
    assert cache.get("a/b") == b"3"
    cache.delete("a/b")
    assert cache.folders("a") == []

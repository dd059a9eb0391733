"""Shared stages: whole or missing, verified when they are fetched, removed when they are old."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

import pytest

from firstfix.builds.shared_stages import SharedStages, collect_stages
from firstfix.store.store import Store
from tests.interleavings import Step, run_every_order, run_interleaved

KEY, OTHER = "a" * 64, "b" * 64


@pytest.fixture
def store(any_store_url: str) -> Store:
    return Store.open(any_store_url)


@pytest.fixture
def made(tmp_path: Path) -> Path:
    folder = tmp_path / "made"
    (folder / "sub").mkdir(parents=True)
    (folder / "points of map.npy").write_bytes(bytes(range(256)) * 1000)
    (folder / "sub" / "b.bin").write_bytes(b"b")
    (folder / "same.bin").write_bytes(b"b")
    (folder / "empty").write_bytes(b"")
    return folder


def contents(folder: Path) -> dict[str, bytes]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def fetched(store: Store, tmp_path: Path, key: str = KEY) -> dict[str, bytes] | None:
    folder = tmp_path / f"fetched{time.monotonic_ns()}"
    folder.mkdir()
    if SharedStages(store).fetch(key, folder):
        return contents(folder)
    assert list(folder.iterdir()) == [], "nothing half fetched stays"
    return None


def test_a_stage_comes_back_as_it_was(store: Store, made: Path, tmp_path: Path):
    assert fetched(store, tmp_path) is None
    assert SharedStages(store).put(KEY, "mesh", made) == 256_001
    assert SharedStages(store).put(KEY, "mesh", made) == 0, "it is there"
    assert fetched(store, tmp_path) == contents(made)
    assert fetched(store, tmp_path, OTHER) is None


def test_a_stage_without_its_record_does_not_exist(store: Store, made: Path, tmp_path: Path):
    SharedStages(store).put(KEY, "mesh", made)
    store.delete(f"stages/{KEY}/stage.json")
    assert fetched(store, tmp_path) is None
    assert SharedStages(store).put(KEY, "mesh", made) == 0, "its files are there: only the record was missing"
    assert fetched(store, tmp_path) == contents(made)


@pytest.mark.parametrize("damage", ["altered", "missing"])
def test_a_damaged_stage_is_refused_and_shared_anew(store: Store, made: Path, tmp_path: Path, damage: str):
    SharedStages(store).put(KEY, "mesh", made)
    key = max(store.scan(f"stages/{KEY}"), key=lambda item: item.size_bytes).key
    if damage == "altered":
        store.put(key, bytes(256_000))
    else:
        store.delete(key)
    assert fetched(store, tmp_path) is None
    assert SharedStages(store).put(KEY, "mesh", made) > 0
    assert fetched(store, tmp_path) == contents(made)


@pytest.mark.parametrize(
    "record",
    [
        *(b"{", b"[]", b'{"files": [1]}'),
        *(json.dumps({"files": {name: {"sha256": KEY, "bytes": 1}}}).encode() for name in ("../x", "/etc/x")),
        json.dumps({"files": {"x": {"sha256": "../../x", "bytes": 1}}}).encode(),
        json.dumps({"files": {"x": {"sha256": KEY, "bytes": 1 << 60}}}).encode(),
        pytest.param(b" " * (5 << 20), id="huge"),
    ],
)
def test_an_invalid_record_is_no_stage(store: Store, record: bytes, tmp_path: Path):
    store.put(f"stages/{KEY}/stage.json", record)
    assert fetched(store, tmp_path) is None
    assert not (tmp_path / "x").exists()


def test_trouble_with_the_store_does_not_reach_the_build(made: Path, tmp_path: Path):
    store = Store.open(f"file://{tmp_path / 'root'}")
    (tmp_path / "root").rmdir()
    (tmp_path / "root").write_text("a file where the folder should be")
    assert SharedStages(store).put(KEY, "mesh", made) == 0
    assert fetched(store, tmp_path) is None


def test_a_stage_over_the_limit_stays_here(store: Store, made: Path, tmp_path: Path):
    assert SharedStages(store, max_bytes=1000).put(KEY, "mesh", made) == 0
    assert store.list("stages") == []
    SharedStages(store).put(KEY, "mesh", made)
    (tmp_path / "out").mkdir()
    assert not SharedStages(store, max_bytes=1000).fetch(KEY, tmp_path / "out")


def test_old_stages_go_first(made: Path, tmp_path: Path):
    store = Store.open(f"file://{tmp_path / 'store'}")
    keys = ["a" * 64, "b" * 64, "c" * 64]
    for key, age_s in zip(keys, (300, 200, 100), strict=True):
        SharedStages(store).put(key, "mesh", made)
        for path in (tmp_path / "store" / "stages" / key).iterdir():
            os.utime(path, (time.time() - age_s,) * 2)
    one = sum(item.size_bytes for item in store.scan(f"stages/{keys[0]}"))
    kept = collect_stages(store, 1000)
    assert (kept.removed, kept.removed_bytes, kept.kept, kept.kept_bytes) == ((), 0, 3, 3 * one)
    collected = collect_stages(store, 250)
    assert (collected.removed, collected.removed_bytes) == ((keys[0],), one)
    collected = collect_stages(store, 1000, max_bytes=one)
    assert (collected.removed, collected.kept, collected.kept_bytes) == ((keys[1],), 1, one)
    assert fetched(store, tmp_path, keys[1]) is None
    assert fetched(store, tmp_path, keys[2]) == contents(made)
    collect_stages(store, 0)
    assert store.list("stages") == []


def test_a_stage_collected_while_it_is_shared_is_whole_or_missing(made, tmp_path, monkeypatch):
    def run(switches: tuple[int, ...]) -> list[Step]:
        store = Store.open("memory://")
        SharedStages(store).put(KEY, "mesh", made)
        store.delete(f"stages/{KEY}/stage.json")  # what a put that was killed left
        works = [lambda: SharedStages(store).put(KEY, "mesh", made), lambda: collect_stages(store, -5)]
        steps = run_interleaved(works, switches, monkeypatch=monkeypatch)
        assert fetched(store, tmp_path) in (None, contents(made))
        SharedStages(store).put(KEY, "mesh", made)  # it was made again
        assert fetched(store, tmp_path) == contents(made)
        return steps

    run_every_order(run)

"""The stage cache: what is done is not done again, and a kill leaves nothing half done."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from pydantic import BaseModel

import firstfix
import firstfix_builder
from firstfix import native
from firstfix.builds.shared_stages import SharedStages
from firstfix.store.store import Store
from firstfix_builder.execution import source_hash as source_hash_module
from firstfix_builder.execution.source_hash import source_hash
from firstfix_builder.execution.stage_cache import StageCache, StageResult
from tests.waiting import LIMIT_S

X, Y = "1" * 64, "2" * 64


class Recipe(BaseModel):
    depth: int = 9


class Stage:
    """Counts how often it was made."""

    def __init__(self, content: bytes = b"content") -> None:
        self.content, self.made = content, 0

    def __call__(self, out: Path) -> None:
        assert list(out.iterdir()) == []
        self.made += 1
        (out / "sub").mkdir()
        (out / "a.bin").write_bytes(self.content)
        (out / "sub" / "b.bin").write_bytes(b"b")


def test_a_stage_is_made_once(tmp_path: Path) -> None:
    stage = Stage()
    first = StageCache(tmp_path).run("mesh", {"map": X}, Recipe(), stage)
    again = StageCache(tmp_path).run("mesh", {"map": X}, {"depth": 9}, stage)
    assert stage.made == 1
    assert again == first
    assert (first.directory / "a.bin").read_bytes() == b"content"
    assert sorted(path.name for path in first.directory.iterdir()) == ["a.bin", "sub"]


@pytest.mark.parametrize(
    "run",
    [
        lambda cache, stage: cache.run("other", {"map": X}, Recipe(), stage),
        lambda cache, stage: cache.run("mesh", {"map": Y}, Recipe(), stage),
        lambda cache, stage: cache.run("mesh", {"map2": X}, Recipe(), stage),
        lambda cache, stage: cache.run("mesh", {"map": X}, Recipe(depth=10), stage),
        lambda cache, stage: cache.run("mesh", {"map": X}, {}, stage),
    ],
)
def test_a_stage_of_other_inputs_or_config_is_made_anew(
    run: Callable[[StageCache, Stage], object], tmp_path: Path
) -> None:
    cache, stage = StageCache(tmp_path), Stage()
    cache.run("mesh", {"map": X}, Recipe(), stage)
    run(cache, stage)
    assert stage.made == 2


def test_a_stage_of_changed_code_is_made_anew(tmp_path: Path) -> None:
    stage = Stage()
    for version in ("1", "2", "2"):
        StageCache(tmp_path, code_version=version).run("mesh", {}, {}, stage)
    assert stage.made == 2


def test_a_stage_of_a_changed_kernel_is_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage()
    for digest in ("1", "2", "2"):
        monkeypatch.setattr(native, "source_digest", digest)
        source_hash.cache_clear()
        StageCache(tmp_path).run("mesh", {}, {}, stage)
    source_hash.cache_clear()
    assert stage.made == 2


def test_the_hash_of_the_program_covers_every_room(monkeypatch: pytest.MonkeyPatch) -> None:
    hashed: list[str] = []
    monkeypatch.setattr(source_hash_module, "sha256_of", lambda path: hashed.append(path.as_posix()) or "")
    source_hash.cache_clear()
    source_hash()
    source_hash.cache_clear()
    for package in (firstfix, firstfix_builder):
        folder = Path(package.__file__).parent
        assert {path.as_posix() for path in folder.rglob("*.py")} <= set(hashed)
    assert {"engine/localizer.py", "self_test/run.py"} <= {"/".join(name.split("/")[-2:]) for name in hashed}


def test_the_digest_is_of_the_content_alone(tmp_path: Path) -> None:
    cache = StageCache(tmp_path)
    one = cache.run("one", {"map": X}, {}, Stage())
    same = cache.run("two", {"map": Y}, {}, Stage())
    other = cache.run("three", {"map": Y}, {}, Stage(b"other"))
    assert one.digest == same.digest != other.digest


def test_a_failed_stage_leaves_nothing(tmp_path: Path) -> None:
    def fail(out: Path) -> None:
        (out / "half").write_bytes(b"half")
        raise RuntimeError("no")

    cache = StageCache(tmp_path)
    with pytest.raises(RuntimeError, match="no"):
        cache.run("mesh", {}, {}, fail)
    assert list((tmp_path / "stages").iterdir()) == []
    stage = Stage()
    cache.run("mesh", {}, {}, stage)
    assert stage.made == 1


@pytest.mark.parametrize("damage", ["flip", "cut", "remove", "add", "record"])
def test_a_damaged_stage_is_made_again(damage: str, tmp_path: Path) -> None:
    stage = Stage()
    folder = StageCache(tmp_path).run("mesh", {}, {}, stage).directory
    if damage == "flip":
        (folder / "a.bin").write_bytes(b"Content")
    elif damage == "cut":
        (folder / "a.bin").write_bytes(b"")
    elif damage == "remove":
        (folder / "sub" / "b.bin").unlink()
    elif damage == "add":
        (folder / "c.bin").write_bytes(b"")
    else:
        (folder.parent / "stage.json").write_bytes(b'{"files":')
    result = StageCache(tmp_path).run("mesh", {}, {}, stage)
    assert stage.made == 2
    assert (result.directory / "a.bin").read_bytes() == b"content"


KILLED = """
import signal, sys
from pathlib import Path
from firstfix_builder.execution.stage_cache import StageCache, StageResult

def produce(out):
    (out / "a.bin").write_bytes(b"half")
    print("half", flush=True)
    signal.pause()

StageCache(Path(sys.argv[1])).run("mesh", {}, {}, produce)
"""


def test_a_kill_within_a_stage_leaves_no_stage_and_no_rubbish(tmp_path: Path) -> None:
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(tmp_path)], stdout=subprocess.PIPE, text=True
    ) as child:
        assert child.stdout is not None
        assert child.stdout.readline() == "half\n"
        (part,) = (tmp_path / "stages").iterdir()
        StageCache(tmp_path)  # another user of the folder takes no work under way for rubbish
        assert (part / "files" / "a.bin").exists()
        os.kill(child.pid, signal.SIGKILL)
    stage = Stage()
    result = StageCache(tmp_path).run("mesh", {}, {}, stage)
    assert stage.made == 1
    assert (result.directory / "a.bin").read_bytes() == b"content"
    assert list((tmp_path / "stages").iterdir()) == [result.directory.parent]


def test_two_who_make_the_same_stage_agree(tmp_path: Path) -> None:
    both = threading.Barrier(2)

    def produce(out: Path) -> None:
        both.wait(timeout=LIMIT_S)
        (out / "a.bin").write_bytes(b"content")

    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(lambda _: StageCache(tmp_path).run("mesh", {}, {}, produce), range(2)))
    assert results[0] == results[1]
    assert list((tmp_path / "stages").iterdir()) == [results[0].directory.parent]


def test_two_who_make_one_stage_differently_take_that_of_the_first(tmp_path: Path) -> None:
    both = threading.Barrier(2)

    def make(content: bytes) -> StageResult:
        def produce(out: Path) -> None:
            both.wait(timeout=LIMIT_S)
            (out / "a.bin").write_bytes(content)

        return StageCache(tmp_path).run("mesh", {}, {}, produce)

    with ThreadPoolExecutor(2) as pool:
        results = list(pool.map(make, (b"one", b"other")))
    assert results[0] == results[1]


def test_a_damaged_stage_that_another_uses_is_not_taken_for_the_one_just_made(tmp_path: Path) -> None:
    other = StageCache(tmp_path)
    used = other.run("mesh", {}, {}, Stage())
    (used.directory / "a.bin").write_bytes(b"Content")
    with pytest.raises(OSError, match="vanished"):
        StageCache(tmp_path).run("mesh", {}, {}, Stage())


def test_the_longest_unused_stages_go_first(tmp_path: Path) -> None:
    def big(out: Path) -> None:
        (out / "a.bin").write_bytes(bytes(100_000))

    def run_all() -> list[Path]:
        cache = StageCache(tmp_path)
        return [cache.run(name, {}, {}, big).directory.parent for name in ("one", "two", "three")]

    one, two, three = run_all()
    for age_s, stage in ((100, one), (300, two), (200, three)):
        os.utime(stage / "stage.json", (time.time() - age_s,) * 2)
    cache = StageCache(tmp_path, max_bytes=250_000)
    cache.prune()
    assert [one.exists(), two.exists(), three.exists()] == [True, False, True]
    cache.run("one", {}, {}, big)  # used now: not the next to go
    cache.run("four", {}, {}, big)
    assert [one.exists(), three.exists()] == [True, False]


def test_a_stage_that_was_unused_for_long_is_pruned(tmp_path: Path) -> None:
    cache = StageCache(tmp_path)
    old, young = (cache.run(name, {}, {}, Stage()).directory.parent for name in ("old", "young"))
    os.utime(old / "stage.json", (time.time() - 100,) * 2)
    del cache
    StageCache(tmp_path, max_age_s=50).prune()
    assert [old.exists(), young.exists()] == [False, True]


def test_another_machines_stage_is_not_made_again(tmp_path: Path) -> None:
    stage, shared = Stage(), SharedStages(Store.open(f"file://{tmp_path / 'store'}"))
    here = StageCache(tmp_path / "here", shared=shared).run("mesh", {"map": X}, Recipe(), stage)
    there = StageCache(tmp_path / "there", shared=shared).run("mesh", {"map": X}, Recipe(), stage)
    assert stage.made == 1
    assert there.digest == here.digest
    assert there.directory.is_relative_to(tmp_path / "there")
    assert (there.directory / "sub" / "b.bin").read_bytes() == b"b"
    StageCache(tmp_path / "there", shared=shared).run("mesh", {"map": Y}, Recipe(), stage)
    StageCache(tmp_path / "alone").run("mesh", {"map": X}, Recipe(), stage)
    assert stage.made == 3


def test_a_stage_that_cannot_be_had_is_made_and_shared_again(tmp_path: Path) -> None:
    stage, store = Stage(), Store.open(f"file://{tmp_path / 'store'}")
    shared = SharedStages(store)
    StageCache(tmp_path / "one", shared=shared).run("mesh", {}, {}, stage)
    (largest,) = (item.key for item in store.scan("stages") if item.size_bytes == len(stage.content))
    store.put(largest, b"Content")
    StageCache(tmp_path / "two", shared=shared).run("mesh", {}, {}, stage)
    assert stage.made == 2
    again = StageCache(tmp_path / "three", shared=shared).run("mesh", {}, {}, stage)
    assert stage.made == 2
    assert (again.directory / "a.bin").read_bytes() == b"content"


def test_a_stage_in_use_is_never_pruned(tmp_path: Path) -> None:
    user = StageCache(tmp_path)
    kept = user.run("mesh", {}, {}, Stage())
    StageCache(tmp_path, max_bytes=0).prune()
    assert (kept.directory / "a.bin").exists()
    del user
    StageCache(tmp_path, max_bytes=0).prune()
    assert not kept.directory.exists()

"""Results of build stages on disk, each with the key of its inputs.

A repeated or resumed build skips the stages whose results are there.

    <root>/stages/<key>/files/...     what the stage made
    <root>/stages/<key>/stage.json    its name, and sha256 of every file
    <root>/stages/.<unique>/          a stage under way, or what a killed process left of one

The key is the sha256 of the stage's name, the code's version, the versions of the libraries that decide its
result, its inputs' hashes and its own config.
A stage is made in a folder of its own, which is renamed when the stage is complete. So a kill at any moment
leaves either a stage or an unfinished folder. The lock of a process ends with the process, and an unfinished
folder without a lock is removed.

With ``firstfix.builds.shared_stages``, stages that other machines have made are fetched, and stages that are
made here are shared.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import shutil
import time
import uuid
import weakref
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, Self

from pydantic import BaseModel

from firstfix.errors import StoreUnavailable
from firstfix.store.sha256 import sha256_of

from .build_trace import mark_cached
from .library_versions import libraries_of
from .source_hash import source_hash

DEFAULT_MAX_BYTES = 50_000_000_000
DEFAULT_MAX_AGE_S = 30 * 86400.0


class StagesElsewhere(Protocol):
    """A second place for stages: ``SharedStages``, or a proxy of it."""

    def fetch(self, key: str, folder: Path) -> bool:
        """Fetch a stage into an empty folder. Returns whether there is one."""
        ...

    def put(self, key: str, name: str, folder: Path) -> int:
        """Put a finished stage. Returns the bytes that were written."""
        ...


@dataclass(frozen=True)
class StageResult:
    """A finished stage.

    Attributes:
        key: of all that went into it.
        directory: its files, to be read only.
        digest: sha256 of their names and contents: the input hash of the stages that read them.
    """

    key: str
    directory: Path
    digest: str

    @classmethod
    def of(cls, result: StageResult) -> Self:
        """The same stage, with the properties of its kind (``stage_results``)."""
        return cls(result.key, result.directory, result.digest)


class StageCache:
    """Stages below one folder. Many threads and processes may share the folder.

    Results of ``run`` stay on disk as long as this object lives, even if another process prunes.

    Args:
        root: made if missing.
        max_bytes: limit on the size of all stages; beyond it, the longest unused ones are removed.
        max_age_s: stages that were not used for this time are removed in any case.
        shared: where stages are fetched from and shared besides; None: nowhere.
        code_version: of the program that makes a stage; by default ``source_hash``, so that a changed one
            never reads the results of the former one.
    """

    def __init__(
        self,
        root: Path,
        *,
        max_bytes: int = DEFAULT_MAX_BYTES,
        max_age_s: float = DEFAULT_MAX_AGE_S,
        shared: StagesElsewhere | None = None,
        code_version: str | None = None,
    ) -> None:
        self._folder = root / "stages"
        self._folder.mkdir(parents=True, exist_ok=True)
        self._max_bytes = max_bytes
        self._max_age_s = max_age_s
        self._shared = shared
        self._code_version = source_hash() if code_version is None else code_version
        self._in_use: list[int] = []  # shared locks on the stages that were handed out
        weakref.finalize(self, _close_all, self._in_use)
        self._remove_unfinished()

    def run(
        self,
        name: str,
        inputs: Mapping[str, str],
        config: BaseModel | Mapping[str, Any],
        produce: Callable[[Path], None],
    ) -> StageResult:
        """The stage's result: from the cache, shared by another machine, or made now.

        Args:
            inputs: name to sha256 of what the stage reads.
            config: of this stage: everything that decides its result besides the inputs.
            produce: writes its files into the empty folder that it is given.

        Raises:
            Exception: any error of ``produce``; nothing is kept then.
        """
        key = self.key_of(name, inputs, config)
        found = self._find(key)
        if found is not None:
            mark_cached(name)
            return found
        fetched = False

        def fill(files: Path) -> None:
            nonlocal fetched
            fetched = self._shared is not None and self._shared.fetch(key, files)
            if fetched:
                mark_cached(name)
            else:
                produce(files)

        found = self._keep(key, name, fill)
        if self._shared is not None and not fetched:
            self._shared.put(key, name, found.directory)
        self.prune()
        return found

    def key_of(self, name: str, inputs: Mapping[str, str], config: BaseModel | Mapping[str, Any]) -> str:
        """The key under which ``run`` finds a stage.

        Args:
            name: of the stage; of a chunk with the kind of its work, after a slash.
        """
        plain = config.model_dump(mode="json") if isinstance(config, BaseModel) else dict(config)
        recipe = {
            "stage": name,
            "code": self._code_version,
            "libraries": libraries_of(name.partition("/")[0]),
            "inputs": dict(inputs),
            "config": plain,
        }
        return hashlib.sha256(json.dumps(recipe, sort_keys=True).encode()).hexdigest()

    def fetched(self, key: str) -> StageResult:
        """A stage that another machine made: from this folder, or from where stages are shared.

        Raises:
            StoreUnavailable: it is in neither.
        """
        found = self._find(key)
        if found is not None:
            return found

        def fill(files: Path) -> None:
            if self._shared is None or not self._shared.fetch(key, files):
                raise StoreUnavailable(f"stage {key[:12]} cannot be fetched from the store")

        found = self._keep(key, "fetched", fill)
        self.prune()
        return found

    def _keep(self, key: str, name: str, fill: Callable[[Path], None]) -> StageResult:
        """A new stage of the files that ``fill`` writes."""
        part, lock = self._new_part()
        try:
            (part / "files").mkdir()
            fill(part / "files")
            made = _hashes(part / "files")
            (part / "stage.json").write_text(json.dumps({"stage": name, "files": made}, sort_keys=True))
            is_own = self._move_in(part, key)
        finally:
            shutil.rmtree(part, ignore_errors=True)
            os.close(lock)
        found = self._find(key, made if is_own else None)
        if found is None:
            raise OSError(f"stage {name} vanished from {self._folder} as it was written")
        return found

    def prune(self) -> None:
        """Remove stages that were unused for too long, then the oldest ones beyond ``max_bytes``."""
        stages = [path for path in self._folder.iterdir() if not path.name.startswith(".")]
        sizes = {path: _size_bytes(path) for path in stages}
        total = sum(sizes.values())
        oldest = time.time() - self._max_age_s
        for path in sorted(stages, key=_last_use):
            if total <= self._max_bytes and _last_use(path) >= oldest:
                return
            if self._remove(path):
                total -= sizes[path]

    def _find(self, key: str, made: Mapping[str, str] | None = None) -> StageResult | None:
        """The stage, locked against pruning; None if it is missing or damaged.

        Args:
            made: hashes of its files, which were just written; None: they are read and hashed.
        """
        path = self._folder / key
        lock = _lock(path, fcntl.LOCK_SH)
        if lock is None:
            return None
        try:
            recorded = json.loads((path / "stage.json").read_bytes())["files"]
            intact = recorded == (_hashes(path / "files") if made is None else made)
            os.utime(path / "stage.json")
        except (OSError, ValueError, KeyError, TypeError):
            intact = False
        if not intact:  # by a power cut, or changed by somebody: it is made again
            os.close(lock)
            self._remove(path)
            return None
        self._in_use.append(lock)
        content = json.dumps(recorded, sort_keys=True).encode()
        return StageResult(key, path / "files", hashlib.sha256(content).hexdigest())

    def _new_part(self) -> tuple[Path, int]:
        while True:
            part = self._folder / f".{uuid.uuid4().hex}"
            part.mkdir()
            lock = _lock(part, fcntl.LOCK_EX)
            if lock is not None:  # else another process removed it before it was locked
                return part, lock

    def _move_in(self, part: Path, key: str) -> bool:
        """Give a stage its name. Returns False if there is one of that name already."""
        try:
            part.rename(self._folder / key)
        except OSError:
            # Another process made the same stage meanwhile, or uses a damaged one, which then stays.
            if not (self._folder / key).is_dir():
                raise
            return False
        return True

    def _remove(self, path: Path) -> bool:
        lock = _lock(path, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if lock is None:
            return False
        try:
            # Renamed first: a folder named by a key must never hold half a stage.
            doomed = self._folder / f".{uuid.uuid4().hex}"
            path.rename(doomed)
            shutil.rmtree(doomed, ignore_errors=True)
        except FileNotFoundError:
            return False
        finally:
            os.close(lock)
        return True

    def _remove_unfinished(self) -> None:
        for path in self._folder.glob(".*"):
            self._remove(path)


def _lock(folder: Path, operation: int) -> int | None:
    """A handle that holds the lock on a folder; None if the folder is gone, or held by another."""
    try:
        handle = os.open(folder, os.O_RDONLY)
    except FileNotFoundError:
        return None
    try:
        fcntl.flock(handle, operation)
        if folder.stat().st_ino == os.fstat(handle).st_ino:
            return handle
    except (BlockingIOError, FileNotFoundError):
        pass
    os.close(handle)
    return None


def _close_all(handles: list[int]) -> None:
    for handle in handles:
        os.close(handle)


def _hashes(folder: Path) -> dict[str, str]:
    """Name relative to the folder, to sha256."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): sha256_of(path) for path in files}


def _size_bytes(stage: Path) -> int:
    size = 0
    for path in stage.rglob("*"):
        with suppress(FileNotFoundError):
            size += path.stat().st_size
    return size


def _last_use(stage: Path) -> float:
    try:
        return (stage / "stage.json").stat().st_mtime
    except FileNotFoundError:
        return 0.0

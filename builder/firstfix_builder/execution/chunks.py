"""Chunks of a stage: small descriptions of work, and their results in an object store.

    stages/<key>/<sha256>      the arrays that one chunk made
    stages/<key>/stage.json    written last

The layout is that of shared stages (``firstfix.builds.shared_stages``), so they are shared and expire
alike. The key is a hash of everything that makes the result: the kind of work, its values, the code, and
the content of what the chunk reads. So a result never changes, whoever made it, for whatever map or
version, and an existing result is never made again. Workers write arrays to the store directly; the process
that hands out the work never sees them.
"""

from __future__ import annotations

import json
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.shared_stages import RECORD, ROOT, SharedStages
from firstfix.store.store import Store

from .stage_cache import StageResult

Arrays: TypeAlias = dict[str, NDArray[Any]]
_FILE = "arrays.npz"


@dataclass(frozen=True)
class Chunk(ABC):
    """A part of a stage's work: a pure function and the plain values it is called with. Picklable.

    Attributes:
        keeps_interpreter: it holds the interpreter lock, so it runs in a process and not in a thread.
    """

    keeps_interpreter: ClassVar[bool] = False

    @abstractmethod
    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """Returns the chunk's arrays: the same bytes on every machine.

        Args:
            inputs: folders of the finished stages that the stage reads, by its names for them.
        """

    @property
    def values(self) -> dict[str, Any]:
        """The values that decide the result, besides what the chunk reads."""
        return asdict(self)

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of everything that ``run`` reads, by any names. It is cheap: nothing large is hashed anew.

        Chunks of equal values and equal hashes have equal results. By default these are the digests of whole
        stages; a chunk that reads a part of a map tells the hash of that part.
        """
        return {name: result.digest for name, result in inputs.items()}

    @property
    def work(self) -> str:
        """Name of the kind of work."""
        return type(self).__qualname__

    @property
    def plain_values(self) -> dict[str, Any]:
        """``values`` as JSON."""
        text = json.dumps(self.values, sort_keys=True, default=lambda model: model.model_dump(mode="json"))
        plain: dict[str, Any] = json.loads(text)
        return plain


@dataclass(frozen=True)
class KeyedChunk:
    """A chunk with the key of its result."""

    key: str
    chunk: Chunk


class ChunkResults:
    """The results of chunks in one store."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._entries = SharedStages(store)

    def made(self) -> set[str]:
        """Returns the keys that have a result, or had one that was removed in part."""
        return set(self._store.folders(ROOT))

    def has(self, key: str) -> bool:
        """Returns whether a chunk has a result."""
        return self._store.exists(f"{ROOT}/{key}/{RECORD}")

    def put(self, key: str, arrays: Arrays) -> None:
        """Stores a result: whole or not at all."""
        with TemporaryDirectory() as folder:
            named: dict[str, Any] = dict(arrays)
            np.savez(Path(folder) / _FILE, **named)
            self._entries.put_surely(key, "chunk", Path(folder))

    def put_folder(self, key: str, folder: Path) -> None:
        """Stores a result from the files of another store."""
        self._entries.put_surely(key, "chunk", folder)

    def fetch(self, key: str, folder: Path) -> bool:
        """Writes the files of a result into an empty folder. Returns whether there is one, undamaged."""
        return self._entries.fetch(key, folder)

    def load(self, key: str) -> Arrays | None:
        """Returns a result, or None if there is none. A damaged result is removed."""
        with TemporaryDirectory() as folder:
            if not self.fetch(key, Path(folder)):
                return None
            try:
                with np.load(Path(folder) / _FILE, allow_pickle=False) as content:
                    return dict(content)
            except (ValueError, OSError, EOFError, zipfile.BadZipFile):
                self.remove(key)
                return None

    def keep(self, key: str) -> None:
        """Makes a result that was used as young as a new one."""
        where = f"{ROOT}/{key}/{RECORD}"
        self._store.put(where, self._store.get(where))

    def remove(self, key: str) -> None:
        """Removes a result."""
        for name in (f"{ROOT}/{key}/{RECORD}", *self._store.list(f"{ROOT}/{key}")):
            self._store.delete(name)


def make_chunk(store: Store, keyed: KeyedChunk, inputs: Mapping[str, Path]) -> None:
    """Runs a chunk and stores its result."""
    ChunkResults(store).put(keyed.key, keyed.chunk.run(inputs))

"""Chunks of a stage: small descriptions of work, and their results in an object store.

    stages/<key>/<sha256>      the arrays that one chunk made
    stages/<key>/stage.json    written last

The layout is that of shared stages (``firstfix.builds.shared_stages``): chunks are shared and expire in the
same way. The key is a hash of everything that determines the result: the kind of work, its values, the code,
and the content that the chunk reads. So a key has one result, for all machines, maps and versions, and an
existing result is never made again. Workers write the arrays directly to the store; they do not pass through
the process that hands out the work.
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
    """A part of a stage's work: a pure function and its arguments, which are plain values. Picklable.

    Attributes:
        keeps_interpreter: the work holds the interpreter lock, so it runs in a process, not in a thread.
    """

    keeps_interpreter: ClassVar[bool] = False

    @abstractmethod
    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """Returns the chunk's arrays: the same bytes on every machine.

        Args:
            inputs: folders of the finished stages that it reads, by the names that it uses.
        """

    @property
    def values(self) -> dict[str, Any]:
        """The values that determine the result, besides the content that the chunk reads."""
        return asdict(self)

    def reads(self, inputs: Mapping[str, StageResult]) -> Mapping[str, str]:
        """Hashes of everything that ``run`` reads, by any names. Cheap: it hashes nothing large.

        Chunks with equal values and equal hashes have equal results. By default these are the digests of
        whole stages. A chunk that reads only a part of a map returns the hash of that part.
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
        """Returns the keys that have a result, or a partly removed one."""
        return set(self._store.folders(ROOT))

    def has(self, key: str) -> bool:
        """Returns whether a chunk has a result."""
        return self._store.exists(f"{ROOT}/{key}/{RECORD}")

    def put(self, key: str, arrays: Arrays) -> None:
        """Stores a result, completely or not at all."""
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
        """Renews the age of a result that was used, so that it expires later."""
        where = f"{ROOT}/{key}/{RECORD}"
        self._store.put(where, self._store.get(where))

    def remove(self, key: str) -> None:
        """Removes a result."""
        for name in (f"{ROOT}/{key}/{RECORD}", *self._store.list(f"{ROOT}/{key}")):
            self._store.delete(name)


def make_chunk(store: Store, keyed: KeyedChunk, inputs: Mapping[str, Path]) -> None:
    """Runs a chunk and stores its result."""
    ChunkResults(store).put(keyed.key, keyed.chunk.run(inputs))

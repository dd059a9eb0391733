"""Chunks of a stage: small descriptions of work, and their results in an object store.

    stages/<stage key>/chunks/<chunk name>     the arrays that one chunk made

The stage's key is a hash of everything that goes into the stage (``stage_cache``). The chunk's name is a hash
of everything that makes it this part of the stage. So a result never changes, whoever made it, and an
existing result is never made again. Workers write arrays to the store directly; the process that hands out
the work never sees them. The chunks are removed when the stage is done; those of an abandoned build expire
with ``firstfix.builds.shared_stages``.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.shared_stages import ROOT
from firstfix.errors import NotFound
from firstfix.store.store import Store

Arrays: TypeAlias = dict[str, NDArray[Any]]


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
    def name(self) -> str:
        """The sha256 of the kind of work and its values."""
        said = {"work": type(self).__qualname__, "values": asdict(self)}
        text = json.dumps(said, sort_keys=True, default=lambda model: model.model_dump(mode="json"))
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class ChunkResults:
    """The results of one stage's chunks."""

    store: Store
    stage: str

    def made(self) -> set[str]:
        """Returns the names of the chunks that have a result."""
        return {key.rsplit("/", 1)[-1] for key in self.store.list(self._key())}

    def has(self, name: str) -> bool:
        """Returns whether a chunk has a result."""
        return self.store.exists(self._key(name))

    def put(self, name: str, arrays: Arrays) -> None:
        """Stores a result atomically. The first result of a chunk stays, whoever else makes it."""
        content, named = io.BytesIO(), dict[str, Any](arrays)
        np.savez(content, **named)
        self.store.put_new(self._key(name), content.getvalue())

    def load(self, name: str) -> Arrays | None:
        """Returns a result, or None if there is none. A damaged result is removed."""
        try:
            with np.load(io.BytesIO(self.store.get(self._key(name))), allow_pickle=False) as content:
                return dict(content)
        except NotFound:
            return None
        except (ValueError, OSError, EOFError, zipfile.BadZipFile):
            self.store.delete(self._key(name))
            return None

    def remove(self) -> None:
        """Removes all results of the stage."""
        for key in self.store.list(self._key()):
            self.store.delete(key)

    def _key(self, name: str = "") -> str:
        return f"{ROOT}/{self.stage}/chunks/{name}".rstrip("/")


def make_chunk(store: Store, stage: str, chunk: Chunk, inputs: Mapping[str, Path]) -> None:
    """Runs a chunk and stores its result."""
    ChunkResults(store, stage).put(chunk.name, chunk.run(inputs))

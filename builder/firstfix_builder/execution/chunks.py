"""A stage's work in chunks: small descriptions that go to whoever computes, and results in an object store.

    stages/<stage key>/chunks/<chunk name>     the arrays that one chunk made

The stage's key names all that went into the stage (``stage_cache``) and the chunk's name all that makes it
this part of it: so a result never changes, whoever made it, and one that is there is never made again.
Arrays go between a worker and the store, never by way of who hands out the work. When the stage is done
its chunks are removed; those of a build that did not go on expire with ``firstfix.builds.shared_stages``.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from firstfix.builds.shared_stages import ROOT
from firstfix.errors import NotFound, StoreError
from firstfix.store.store import Store

from .stage_cache import StageResult

Arrays: TypeAlias = dict[str, NDArray[Any]]
TRIES = 3  # more of a chunk whose result is damaged, or gone when it is read


@dataclass(frozen=True)
class Chunk(ABC):
    """A part of a stage's work: a pure function with the plain values that it is called with. Pickles.

    Attributes:
        keeps_interpreter: threads would run it one after the other: it takes processes.
    """

    keeps_interpreter: ClassVar[bool] = False

    @abstractmethod
    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        """The same bytes wherever it runs.

        Args:
            inputs: folders of the finished stages that the stage reads, by its names for them.
        """

    @property
    def name(self) -> str:
        """sha256 of the kind of work and its values."""
        said = {"work": type(self).__qualname__, "values": asdict(self)}
        text = json.dumps(said, sort_keys=True, default=lambda model: model.model_dump(mode="json"))
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True)
class ChunkResults:
    """The results of one stage's chunks."""

    store: Store
    stage: str

    def made(self) -> set[str]:
        """Names of the chunks that are there."""
        return {key.rsplit("/", 1)[-1] for key in self.store.list(self._key())}

    def has(self, name: str) -> bool:
        return self.store.exists(self._key(name))

    def put(self, name: str, arrays: Arrays) -> None:
        """Atomic; of several that made the same chunk the first one's stays."""
        content, named = io.BytesIO(), dict[str, Any](arrays)
        np.savez(content, **named)
        self.store.put_new(self._key(name), content.getvalue())

    def load(self, name: str) -> Arrays | None:
        """None where it is not there; what is damaged is removed first."""
        try:
            with np.load(io.BytesIO(self.store.get(self._key(name))), allow_pickle=False) as content:
                return dict(content)
        except NotFound:
            return None
        except (ValueError, OSError, EOFError, zipfile.BadZipFile):
            self.store.delete(self._key(name))
            return None

    def remove(self) -> None:
        for key in self.store.list(self._key()):
            self.store.delete(key)

    def _key(self, name: str = "") -> str:
        return f"{ROOT}/{self.stage}/chunks/{name}".rstrip("/")


class Workers(Protocol):
    """Those who run chunks: threads and processes of this machine, or a cluster."""

    @property
    def store(self) -> Store:
        """Takes the results."""
        ...

    def run(
        self,
        stage: str,
        chunks: Sequence[Chunk],
        inputs: Mapping[str, StageResult],
        done: Callable[[], None],
        cancelled: Callable[[], bool],
    ) -> None:
        """Runs them all: every result is in the store then. ``done`` is called after each.

        Raises:
            BuildCancelled: cancelled() said so; what had not begun is not begun.
            BuildFailed: workers died of a chunk.
            whatever a chunk raises.
        """
        ...


def run_chunks(
    workers: Workers,
    stage: str,
    chunks: Sequence[Chunk],
    inputs: Mapping[str, StageResult],
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> Iterator[Arrays]:
    """Runs the chunks that are not there yet, and gives the results of all in order, one at a time.

    Args:
        stage: its key.

    Raises:
        what ``Workers.run`` raises.
        StoreError: a result is damaged or gone time after time.
    """
    results = ChunkResults(workers.store, stage)
    made = results.made()
    missing = [chunk for chunk in chunks if chunk.name not in made]
    count = len(chunks) - len(missing)

    def done() -> None:
        nonlocal count
        count += 1
        progress(count / len(chunks))

    workers.run(stage, missing, inputs, done, cancelled)
    for chunk in chunks:
        arrays, tries = results.load(chunk.name), TRIES
        while arrays is None:
            if tries == 0:
                raise StoreError(f"the store does not keep chunk {chunk.name[:12]} of stage {stage[:12]}")
            tries -= 1
            workers.run(stage, [chunk], inputs, lambda: None, cancelled)
            arrays = results.load(chunk.name)
        yield arrays


def make_chunk(store: Store, stage: str, chunk: Chunk, inputs: Mapping[str, Path]) -> None:
    """Runs a chunk and puts its result."""
    ChunkResults(store, stage).put(chunk.name, chunk.run(inputs))

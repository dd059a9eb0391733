"""Chunks that count how often they are run, and that can be held up: workers import them too."""

from __future__ import annotations

import hashlib
import json
import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from firstfix.errors import BuildFailed
from firstfix_builder.execution.chunks import Arrays, Chunk, KeyedChunk


@dataclass(frozen=True)
class Toy(Chunk):
    """Adds its number to the numbers of the stage ``numbers``.

    Attributes:
        log: folder that gets a file for every run.
        gate: it does not end before this file is there; empty: at once.
        fate: "fine", "raises", "breaks" with an error of its own, or "dies".
    """

    number: int
    log: str
    gate: str = ""
    fate: str = "fine"

    def run(self, inputs: Mapping[str, Path]) -> Arrays:
        (Path(self.log) / f"{self.number}-{time.time_ns()}-{os.getpid()}").touch()
        while self.gate and not Path(self.gate).exists():
            time.sleep(0.02)
        if self.fate == "raises":
            raise BuildFailed("this one cannot be made")
        if self.fate == "breaks":
            raise ValueError("a fault")
        if self.fate == "dies":
            os._exit(1)
        return {"sum": np.load(inputs["numbers"] / "numbers.npy") + self.number}


def keyed(chunk: Toy) -> KeyedChunk:
    """The chunk with a key of its kind of work and its values."""
    text = json.dumps([chunk.work, chunk.plain_values], sort_keys=True)
    return KeyedChunk(hashlib.sha256(text.encode()).hexdigest(), chunk)


def runs(log: Path, number: int | None = None) -> int:
    """Returns how often one chunk, or any, was begun."""
    return len(list(log.glob("*" if number is None else f"{number}-*")))

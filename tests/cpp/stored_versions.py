"""Versions as they lie in a store, and damaged copies of them."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from firstfix.catalog.manifest import FILE_NAME, Manifest


def stored(directory: Path, versions: Path) -> Path:
    """A copy of a built version, under the sha256 of its manifest."""
    manifest = Manifest.for_directory(directory)
    target = versions / manifest.digest
    shutil.copytree(directory, target)
    (target / FILE_NAME).write_bytes(manifest.to_json())
    return target


def damaged(folder: Path, target: Path, change: Callable[[Path], None]) -> Path:
    """A copy with a change, under another name, so that its manifest may be another one."""
    shutil.copytree(folder, target)
    change(target)
    return target


def rewritten(folder: Path, name: str, content: bytes) -> None:
    """Writes a file of a version, and its manifest as if it had been built so."""
    (folder / name).write_bytes(content)
    manifest = json.loads((folder / FILE_NAME).read_bytes())
    manifest["files"][name] = {"bytes": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    (folder / FILE_NAME).write_text(json.dumps(manifest, sort_keys=True, separators=(",", ":")))


def any_bytes(content: bytes, seed: int) -> Iterator[bytes]:
    """A file cut off, too long, of something else, and with some bytes changed: most in its head."""
    rng, head = np.random.default_rng(seed), min(len(content), 1200)
    yield from (content[:size] for size in (0, 1, 9, len(content) // 2, len(content) - 1))
    yield from (content + b"x", b"[" * 60_000)
    for number in range(25):
        wrong = bytearray(content)
        for at in rng.integers(0, head if number < 20 else len(content), 3 if number < 20 else 3000):
            wrong[at] = rng.integers(0, 256)
        yield bytes(wrong)

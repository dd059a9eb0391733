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


def swapped(folder: Path, first: str, second: str) -> None:
    """Exchanges two files of a version, and says so in its manifest."""
    contents = [(folder / name).read_bytes() for name in (first, second)]
    rewritten(folder, first, contents[1])
    rewritten(folder, second, contents[0])


def header_of(content: bytes) -> tuple[dict[str, dict[str, object]], int]:
    """The header of a safetensors file, and where its numbers begin."""
    length = int.from_bytes(content[:8], "little")
    return json.loads(content[8 : 8 + length]), 8 + length


def other_shapes(content: bytes) -> Iterator[tuple[str, bytes]]:
    """A safetensors file with an array of as many numbers in another shape, or of another type."""
    header, start = header_of(content)
    for name, entry in header.items():
        if name == "__metadata__":
            continue
        shape = [int(str(along)) for along in entry["shape"]]  # type: ignore[attr-defined]
        for wrong in ([*shape, 1], [int(np.prod(shape))], [0, *shape]):
            if wrong == shape:
                continue
            changed = json.dumps({**header, name: {**entry, "shape": wrong}}).encode()
            padded = changed + b" " * (-len(changed) % 8)
            yield f"{name} {wrong}", len(padded).to_bytes(8, "little") + padded + content[start:]


def pointing_anywhere(content: bytes, seed: int) -> Iterator[tuple[str, bytes]]:
    """A safetensors file with whole numbers of an array that point to where nothing is."""
    rng = np.random.default_rng(seed)
    header, start = header_of(content)
    for name, entry in header.items():
        if name == "__metadata__" or entry["dtype"] != "I32":
            continue
        begin, end = (start + int(offset) for offset in entry["data_offsets"])  # type: ignore[attr-defined]
        numbers = np.frombuffer(content[begin:end], "<i4")
        for share in (0.02, 1.0):
            wrong = numbers.copy()
            chosen = rng.random(len(wrong)) < share
            wrong[chosen] = rng.choice([-(2**31), -2, 0, 1, len(wrong), 2**24, 2**31 - 1], int(chosen.sum()))
            yield f"{name} {share}", content[:begin] + wrong.tobytes() + content[end:]

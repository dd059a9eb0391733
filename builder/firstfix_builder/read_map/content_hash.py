"""The hash of a source's content: one file, or the folder of a SLAM package."""

from __future__ import annotations

import hashlib
from pathlib import Path

from firstfix.store.sha256 import sha256_of


def content_hash(path: Path) -> str:
    """sha256 of a file; of a folder, of its files' names and hashes. Hidden files do not count."""
    if path.is_file():
        return sha256_of(path)
    digest = hashlib.sha256()
    for file in sorted(path.rglob("*")):
        name = file.relative_to(path).as_posix()
        if file.is_file() and not any(part.startswith(".") for part in name.split("/")):
            digest.update(f"{name}\0{sha256_of(file)}\n".encode())
    return digest.hexdigest()

"""Hash of the program: results of stages made by other source code are not reused."""

from __future__ import annotations

import functools
import hashlib
from pathlib import Path

import firstfix
import firstfix_builder
from firstfix import native
from firstfix.store.sha256 import sha256_of


@functools.cache
def source_hash() -> str:
    """A hash of the source code of core and builder, the compiled core's included.

    It is the same for all instruction sets, as their results are.
    """
    digest = hashlib.sha256(native.source_digest.encode())
    for package in (Path(firstfix.__file__).parent, Path(firstfix_builder.__file__).parent):
        taught = package.rglob("taught/*")  # what ships with the release decides a version, too
        for path in sorted([*package.rglob("*.py"), *taught]):
            digest.update(f"{path.relative_to(package)}\0{sha256_of(path)}\n".encode())
    return digest.hexdigest()

"""A checkout of the project, whose code is run in processes of its own."""

from __future__ import annotations

import hashlib
import os
import sys
from dataclasses import dataclass
from pathlib import Path

_PACKAGES = ("core", "builder", "service", "clients/python", "cli")
_SOURCES = ("core", "builder", "native")
_SUFFIXES = {".py", ".hpp", ".cpp", ".txt", ".cmake"}
_ONE_THREAD = {
    f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "BLIS", "VECLIB", "NUMEXPR")
}


@dataclass(frozen=True)
class Tree:
    """A checkout.

    Attributes:
        name: of its figures.
        root: its folder.
    """

    name: str
    root: Path

    def command(self, module: str, *arguments: str) -> list[str]:
        """The command that runs a module of this package with the checkout's code."""
        return [sys.executable, "-m", f"{__package__}.{module}", *arguments]

    def environment(self) -> dict[str, str]:
        """The environment of its processes: its packages, and one thread for each library."""
        packages = os.pathsep.join(str(self.root / package) for package in _PACKAGES)
        return {**os.environ, **_ONE_THREAD, "PYTHONPATH": packages}

    def code_digest(self) -> str:
        """A hash of the sources that answers and builds are made with."""
        digest = hashlib.sha256()
        for path in sorted(one for folder in _SOURCES for one in (self.root / folder).rglob("*")):
            if path.suffix in _SUFFIXES:
                digest.update(str(path.relative_to(self.root)).encode() + b"\0" + path.read_bytes())
        return digest.hexdigest()

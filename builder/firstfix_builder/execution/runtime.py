"""What decides the bytes that a chunk comes to: machines that share a build have to have it in common."""

from __future__ import annotations

import platform
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version

import firstfix

from .stage_cache import source_hash


@dataclass(frozen=True)
class Runtime:
    """Attributes:
    code: hash of the sources of builder and core.
    machine: the processor's architecture.
    """

    firstfix: str
    code: str
    python: str
    numpy: str
    scipy: str
    open3d: str
    machine: str

    def differences(self, other: Runtime) -> str:
        """What the other has otherwise, for people; empty where it is the same."""
        mine, theirs = asdict(self), asdict(other)
        return ", ".join(
            f"{name} {theirs[name][:12]} where {mine[name][:12]} is needed"
            for name in mine
            if mine[name] != theirs[name]
        )


@cache
def this_runtime() -> Runtime:
    return Runtime(
        firstfix=firstfix.__version__,
        code=source_hash(),
        python=f"{sys.version_info.major}.{sys.version_info.minor}",
        numpy=version("numpy"),
        scipy=version("scipy"),
        open3d=_open3d(),
        machine=platform.machine(),
    )


def _open3d() -> str:
    """Told without importing it, which takes seconds."""
    for name in ("open3d-cpu", "open3d"):
        with suppress(PackageNotFoundError):
            return version(name)
    return "none"

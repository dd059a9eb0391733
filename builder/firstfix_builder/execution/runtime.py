"""Software versions that determine a chunk's bytes. Machines that share a build must have the same."""

from __future__ import annotations

import platform
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version

import firstfix

from .source_hash import source_hash


@dataclass(frozen=True)
class Runtime:
    """Software versions of one machine.

    Attributes:
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
        """Returns the differences of another machine as a message, empty if there are none."""
        mine, theirs = asdict(self), asdict(other)
        return ", ".join(
            f"{name} {theirs[name][:12]} where {mine[name][:12]} is needed"
            for name in mine
            if mine[name] != theirs[name]
        )


@cache
def this_runtime() -> Runtime:
    """Returns the software versions of this process."""
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
    """Version of Open3D, from the package metadata: an import would take seconds."""
    for name in ("open3d-cpu", "open3d"):
        with suppress(PackageNotFoundError):
            return version(name)
    return "none"

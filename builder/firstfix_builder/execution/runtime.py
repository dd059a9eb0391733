"""Software versions that determine a chunk's bytes. Machines that share a build must have the same."""

from __future__ import annotations

import platform
import sys
from dataclasses import asdict, dataclass
from functools import cache

import firstfix

from .library_versions import version_of
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
    faiss: str
    machine: str

    def differences(self, other: Runtime) -> str:
        """The differences of another machine as a message, empty if there are none."""
        mine, theirs = asdict(self), asdict(other)
        return ", ".join(
            f"{name} {theirs[name][:12]} where {mine[name][:12]} is needed"
            for name in mine
            if mine[name] != theirs[name]
        )


@cache
def this_runtime() -> Runtime:
    """The software versions of this process."""
    return Runtime(
        firstfix=firstfix.__version__,
        code=source_hash(),
        python=f"{sys.version_info.major}.{sys.version_info.minor}",
        numpy=version_of("numpy"),
        scipy=version_of("scipy"),
        open3d=version_of("open3d"),
        faiss=version_of("faiss"),
        machine=platform.machine(),
    )

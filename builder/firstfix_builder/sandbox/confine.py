"""Confines this process, before it reads untrusted files."""

from __future__ import annotations

import resource
import sys
from dataclasses import dataclass
from pathlib import Path

from .kernel import (
    SIGNALS_VERSION,
    allow_only,
    drop_capabilities,
    end_with_parent,
    gain_no_privileges,
    landlock_version,
)
from .seccomp import refuse_system_calls

MAX_OPEN_FILES = 4096
# Programs and libraries of the system, and files that libraries read when they are loaded.
_SYSTEM = ("/usr", "/bin", "/lib", "/lib32", "/lib64", "/opt/firstfix")
_SYSTEM_FILES = (
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/etc/mime.types",
    "/etc/fonts",
    "/etc/ssl/openssl.cnf",
    "/dev/urandom",
    "/dev/random",
    "/proc",  # Landlock hides the memory and environment of processes outside the sandbox
    "/sys/devices/system",
)
_WRITABLE = ("/dev/null", "/dev/shm")  # the second for multiprocessing's semaphores


@dataclass(frozen=True)
class Limits:
    """Resource limits of one process.

    Attributes:
        memory_bytes: private memory that it may reserve, used or not.
        file_bytes: size of one file.
    """

    memory_bytes: int
    file_bytes: int


def confine(*, read: tuple[Path, ...], write: tuple[Path, ...], limits: Limits) -> list[str]:
    """Confine this process and its children, permanently. Returns what the kernel cannot confine, as text.

    Args:
        read, write: folders that it may read and write, besides those of the system and of Python.
    """
    missing = []
    end_with_parent()
    _limit(limits)
    gain_no_privileges()
    try:
        allow_only(
            run=[*map(Path, _SYSTEM), *_python_folders()],
            read=[*map(Path, _SYSTEM_FILES), *read],
            write=[*map(Path, _WRITABLE), *write],
        )
    except OSError as error:
        missing.append(
            f"files of its user can be read, processes of its user too (no Landlock: {error.strerror})"
        )
    else:
        if landlock_version() < SIGNALS_VERSION:
            missing.append(
                f"processes of its user can be signalled (Landlock before version {SIGNALS_VERSION})"
            )
    drop_capabilities()
    try:
        refuse_system_calls()
    except OSError as error:
        missing.append(f"the network is open (no seccomp: {error.strerror})")
    return missing


def _limit(limits: Limits) -> None:
    wanted = {
        resource.RLIMIT_CORE: 0,
        resource.RLIMIT_NOFILE: MAX_OPEN_FILES,
        resource.RLIMIT_DATA: limits.memory_bytes,
        resource.RLIMIT_FSIZE: limits.file_bytes,
    }
    for kind, value in wanted.items():
        _, hard = resource.getrlimit(kind)
        within = value if hard == resource.RLIM_INFINITY else min(value, hard)
        resource.setrlimit(kind, (within, within))


def _python_folders() -> list[Path]:
    """Folders of this interpreter and its modules."""
    executable = Path(sys.executable)
    named = [sys.prefix, sys.base_prefix, sys.exec_prefix, *filter(None, sys.path)]
    folders = {executable.parent, executable.resolve().parent, *(Path(name).resolve() for name in named)}
    return sorted(folder for folder in folders if folder != Path("/"))

"""Confines this process, before it reads untrusted files."""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import stat
import struct
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from .seccomp import refuse_system_calls

_libc = ctypes.CDLL(None, use_errno=True)
_SET_PDEATHSIG, _SET_NO_NEW_PRIVS = 1, 38
_CAPSET = {"x86_64": 126, "aarch64": 91}
_CAPABILITY_VERSION_3 = 0x20080522


def prctl(option: int, *arguments: int) -> None:
    """Sets an attribute of this process; the manual page of the call lists them.

    Raises:
        OSError: the kernel refuses.
    """
    given = [ctypes.c_ulong(value) for value in (*arguments, 0, 0, 0, 0)][:4]
    if _libc.prctl(option, *given) != 0:
        raise _failure("prctl")


def system_call(number: int, *arguments: object) -> int:
    """Makes a system call and returns its result.

    Raises:
        OSError: the kernel refuses.
    """
    result: int = _libc.syscall(ctypes.c_long(number), *arguments)
    if result < 0:
        raise _failure(f"system call {number}")
    return result


def gain_no_privileges() -> None:
    """Prevents this process from gaining privileges, also by programs with a set-user bit."""
    prctl(_SET_NO_NEW_PRIVS, 1)


def end_with_parent() -> None:
    """Lets the kernel kill this process when its parent ends, even if the parent is killed."""
    parent = os.getppid()
    prctl(_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it has ended meanwhile
        os.kill(os.getpid(), signal.SIGKILL)


def drop_capabilities() -> None:
    """Drops all capabilities, those of root, too."""
    number = _CAPSET.get(os.uname().machine)
    if number is None:
        return
    header = (ctypes.c_uint32 * 2)(_CAPABILITY_VERSION_3, 0)
    system_call(number, header, (ctypes.c_uint32 * 6)())


def _failure(what: str) -> OSError:
    number = ctypes.get_errno()
    return OSError(number, f"{what}: {os.strerror(number)}")


_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # on every machine
_VERSION, _PATH_BENEATH = 1, 1
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 2, 4, 8
_REFER, _TRUNCATE, _IOCTL_DEVICE = 1 << 13, 1 << 14, 1 << 15
_FIRST_RIGHTS = (1 << 13) - 1  # those of the first version
_OF_FILES = _EXECUTE | _WRITE_FILE | _READ_FILE | _TRUNCATE | _IOCTL_DEVICE
_READ = _READ_FILE | _READ_DIR
_MAKE_DEVICES = 1 << 6 | 1 << 11  # characters, blocks
_NO_TCP, _NO_SIGNAL_NOR_ABSTRACT_SOCKET = 3, 3
SIGNALS_VERSION = 6


def landlock_version() -> int:
    """Version of Landlock; 0 if the kernel has none, or it is switched off."""
    try:
        return system_call(_CREATE_RULESET, None, ctypes.c_size_t(0), ctypes.c_uint32(_VERSION))
    except OSError:
        return 0


def allow_only(*, run: Iterable[Path], read: Iterable[Path], write: Iterable[Path]) -> None:
    """Permanently refuses access to all other files, with EACCES.

    Needs PR_SET_NO_NEW_PRIVS, and a process without other threads, because these would not be confined.

    Args:
        run: folders and files that may be read and executed.
        write: folders in which files may be created, or devices.

    Raises:
        OSError: the kernel has no Landlock, or refuses.
    """
    version = landlock_version()
    rights = _FIRST_RIGHTS
    for since, right in ((2, _REFER), (3, _TRUNCATE), (5, _IOCTL_DEVICE)):
        if version >= since:
            rights |= right
    ruleset = struct.pack("=QQQ", rights, _NO_TCP, _NO_SIGNAL_NOR_ABSTRACT_SOCKET)
    size = 24 if version >= SIGNALS_VERSION else 16 if version >= 4 else 8
    handle = system_call(_CREATE_RULESET, ruleset, ctypes.c_size_t(size), ctypes.c_uint32(0))
    try:
        _add(handle, run, (_EXECUTE | _READ) & rights)
        _add(handle, read, _READ & rights)
        _add(handle, write, rights & ~(_EXECUTE | _MAKE_DEVICES | _IOCTL_DEVICE))
        system_call(_RESTRICT_SELF, ctypes.c_int(handle), ctypes.c_uint32(0))
    finally:
        os.close(handle)


def _add(ruleset: int, paths: Iterable[Path], rights: int) -> None:
    for path in _there(paths):
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
        try:
            is_folder = stat.S_ISDIR(os.fstat(handle).st_mode)
            rule = struct.pack("=Qi", rights if is_folder else rights & _OF_FILES, handle)
            system_call(
                _ADD_RULE, ctypes.c_int(ruleset), ctypes.c_int(_PATH_BENEATH), rule, ctypes.c_uint32(0)
            )
        finally:
            os.close(handle)


def _there(paths: Iterable[Path]) -> Sequence[Path]:
    return sorted({path for path in paths if path.exists()})


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
    """Confines this process and its children, permanently. Returns what the kernel cannot confine, as text.

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

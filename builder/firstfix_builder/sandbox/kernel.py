"""System calls for which Python has no function, and Landlock on top of them.

Landlock limits the files that this process and its children may read and write. It also prevents a process
from reading other processes outside its sandbox (their memory, their ``/proc/<pid>/environ``), and from
sending signals to them. The kernel's documentation is Documentation/userspace-api/landlock.rst.
"""

from __future__ import annotations

import ctypes
import os
import signal
import stat
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

_libc = ctypes.CDLL(None, use_errno=True)
_SET_PDEATHSIG, _SET_NO_NEW_PRIVS = 1, 38
_CAPSET = {"x86_64": 126, "aarch64": 91}
_CAPABILITY_VERSION_3 = 0x20080522


def prctl(option: int, *arguments: int) -> None:
    """Set an attribute of this process; the manual page of the call lists them.

    Raises:
        OSError: the kernel refuses.
    """
    given = [ctypes.c_ulong(value) for value in (*arguments, 0, 0, 0, 0)][:4]
    if _libc.prctl(option, *given) != 0:
        raise _failure("prctl")


def system_call(number: int, *arguments: object) -> int:
    """Make a system call and return its result.

    Raises:
        OSError: the kernel refuses.
    """
    result: int = _libc.syscall(ctypes.c_long(number), *arguments)
    if result < 0:
        raise _failure(f"system call {number}")
    return result


def gain_no_privileges() -> None:
    """Prevent this process from gaining privileges, also by programs with a set-user bit."""
    prctl(_SET_NO_NEW_PRIVS, 1)


def end_with_parent() -> None:
    """Let the kernel kill this process when its parent ends, even if the parent is killed."""
    parent = os.getppid()
    prctl(_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:  # it has ended meanwhile
        os.kill(os.getpid(), signal.SIGKILL)


def drop_capabilities() -> None:
    """Drop all capabilities, those of root, too."""
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

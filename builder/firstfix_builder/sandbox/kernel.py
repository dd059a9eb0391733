"""System calls for which Python has no function."""

from __future__ import annotations

import ctypes
import os
import signal

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

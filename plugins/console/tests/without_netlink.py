"""Runs a program to which the kernel does not tell that networks come and go: its arguments are the command.

Chromium aborts its waiting requests with ERR_NETWORK_CHANGED when the machine gets a network. Tests of
containers and of lossy links, which run beside those of the console, make some. Where Chromium cannot open
the socket by which it would hear of them, it counts as online.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import struct
import sys

from firstfix_builder.sandbox.kernel import gain_no_privileges, prctl

_SET_SECCOMP, _MODE_FILTER = 22, 2
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | errno.EAFNOSUPPORT
_LOAD, _UNLESS_EQUAL, _RETURN = 0x20, 0x15, 0x06
_NUMBER, _FAMILY = 0, 16  # offsets in struct seccomp_data
_AF_NETLINK = 16
_SOCKET = {"x86_64": 41, "aarch64": 198}


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_ushort), ("code", ctypes.c_char_p))


def refuse_netlink() -> None:
    """Refuses netlink sockets to this process and its children, permanently."""
    steps = [
        (_LOAD, 0, 0, _NUMBER),
        (_UNLESS_EQUAL, 0, 3, _SOCKET[platform.machine()]),
        (_LOAD, 0, 0, _FAMILY),
        (_UNLESS_EQUAL, 0, 1, _AF_NETLINK),
        (_RETURN, 0, 0, _REFUSE),
        (_RETURN, 0, 0, _ALLOW),
    ]
    code = b"".join(struct.pack("=HBBI", *step) for step in steps)
    program = _Program(len(steps), code)
    gain_no_privileges()
    prctl(_SET_SECCOMP, _MODE_FILTER, ctypes.addressof(program))


if __name__ == "__main__":
    refuse_netlink()
    os.execv(sys.argv[1], sys.argv[1:])

"""Ports and DDS domains that one test process has for itself, among all tests that run on this machine."""

from __future__ import annotations

import fcntl
import os
import random
import socket
import tempfile
from collections.abc import Iterable
from pathlib import Path

# Below the ports that the kernel gives to whoever connects, or asks for any.
_PORTS = range(20_000, 30_000)
_DOMAINS = range(1, 100)  # above 100 their ports are those that the kernel gives

# A byte of this file stands for a number. The kernel's lock on it ends with the process that has it.
_FILE = Path(tempfile.gettempdir()) / f"firstfix-tests-{os.getuid()}.claimed"
_lock_of_all = _FILE.open("ab")
_of_this_process: set[int] = set()


def free_port() -> int:
    """A TCP port of loopback that nobody has. It stays this process's, also while nothing listens on it."""
    while True:
        port = _claim(_PORTS)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:  # another program's
                continue
        return port


def any_domain() -> int:
    """A DDS domain that no test has, nor had in this process: a participant may outlive its test."""
    return _claim(_DOMAINS)


def _claim(numbers: Iterable[int]) -> int:
    shuffled = [number for number in numbers if number not in _of_this_process]
    random.SystemRandom().shuffle(shuffled)
    for number in shuffled:
        try:
            fcntl.lockf(_lock_of_all, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, number)
        except OSError:  # another process has it
            continue
        _of_this_process.add(number)
        return number
    raise RuntimeError(f"tests have all of {numbers}: too many runs on this machine")

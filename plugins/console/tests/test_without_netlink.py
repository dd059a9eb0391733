"""The browser of these tests hears of no network that other tests make."""

from __future__ import annotations

import errno
import subprocess
import sys
from pathlib import Path

_PROGRAM = """
import socket
socket.socket(socket.AF_INET).close()
try:
    socket.socket(socket.AF_NETLINK, socket.SOCK_RAW)
except OSError as error:
    print(error.errno)
"""


def test_netlink_is_refused_and_nothing_else():
    wrapper = Path(__file__).with_name("without_netlink.py")
    ended = subprocess.run(
        [sys.executable, wrapper, sys.executable, "-c", _PROGRAM], capture_output=True, text=True, check=True
    )
    assert ended.stdout.strip() == str(errno.EAFNOSUPPORT), ended.stderr

"""A free port for a server that a command starts on this machine."""

from __future__ import annotations

import random
import socket
from contextlib import suppress

# Below the ports that the kernel gives to whoever connects: none of them is taken by a mere client
# between the choice and the start of the server.
_PORTS = range(10_000, 20_000)
_given: set[int] = set()


def free_port(wanted: int = 0) -> int:
    """A TCP port of loopback on which nothing listens. No two calls of a process return the same one.

    Args:
        wanted: is returned if it is free; 0: any port will do.

    Raises:
        OSError: none is left.
    """
    left = [port for port in _PORTS if port not in _given]
    random.SystemRandom().shuffle(left)
    for port in [wanted, *left] if wanted and wanted not in _given else left:
        if _is_free(port):
            _given.add(port)
            return port
    raise OSError(f"no free TCP port between {_PORTS.start} and {_PORTS.stop - 1}")


def _is_free(port: int) -> bool:
    """Whether a server could listen on a TCP port of loopback."""
    with socket.socket() as probe, suppress(OSError):
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind(("127.0.0.1", port))
        return True
    return False

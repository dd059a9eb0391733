"""Check of an address before the work of a start: whether a server can listen there."""

from __future__ import annotations

import errno
import os
import socket

EXIT_NOT_STARTED = 6


class StartFailed(Exception):
    """The process cannot start: its port is in use, for example."""


def check_port(host: str, port: int, option: str = "--port") -> None:
    """Check that a server can listen at an address. Port 0 is any free one.

    Args:
        option: by which another port can be given.

    Raises:
        StartFailed: somebody listens there, or there is no such address.
    """
    try:
        addresses = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except socket.gaierror as error:
        raise StartFailed(f"cannot listen at {host}: {error.strerror}") from None
    for family, kind, protocol, _, address in addresses:
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            if family == socket.AF_INET6:
                probe.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
            try:
                probe.bind(address)
            except OSError as error:
                raise StartFailed(_why(host, port, option, error)) from None


def _why(host: str, port: int, option: str, error: OSError) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} of {host} is in use: give another one with {option}, or 0 for any free one"
    return f"cannot listen at port {port} of {host}: {os.strerror(error.errno or 0)}"

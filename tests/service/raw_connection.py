"""A plain connection to a service, for bytes that no HTTP client would send."""

from __future__ import annotations

import socket

from tests.service.service_world import Service
from tests.waiting import LIMIT_S


def connect(service: Service) -> socket.socket:
    port = int(service.url.rpartition(":")[2])
    return socket.create_connection(("127.0.0.1", port), timeout=LIMIT_S)


def all_of(connection: socket.socket) -> bytes:
    """Reads until the service closes."""
    found = b""
    try:
        while piece := connection.recv(1 << 16):
            found += piece
    except ConnectionError:  # closed while we were still sending
        pass
    return found

"""A connection that another thread can close during a query."""

from __future__ import annotations

import socket
import threading
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import httpx

# Events of httpcore when a socket is there: plain, through a proxy, or with TLS.
_CONNECTED = ("connect_tcp.complete", "connect_unix_socket.complete", "start_tls.complete")


class AbortableConnection:
    """At most one connection, for one query at a time.

    httpx cannot cancel a request from another thread. But shutting down the socket ends every wait on it, and
    the service sees that the caller is gone.

    Args:
        http: used by this object only, with a limit of one connection.
    """

    def __init__(self, http: httpx.Client) -> None:
        self._http = http
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._aborted = False

    def send(self, request: httpx.Request, *, stream: bool = False) -> httpx.Response:
        """Sends a request and returns the response.

        Raises:
            httpx.TransportError: no answer, or ``abort`` was called.
        """
        request.extensions = {**request.extensions, "trace": self._on_trace}
        return self._http.send(request, stream=stream)

    def abort(self) -> None:
        """Ends the request under way. The connection cannot be used again."""
        with self._lock:
            self._aborted = True
            if self._socket is not None:
                with suppress(OSError):  # the other side closed it first
                    self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Closes the connection."""
        self._http.close()

    def _on_trace(self, event: str, info: Mapping[str, Any]) -> None:
        if not event.endswith(_CONNECTED):
            return
        with self._lock:
            self._socket = info["return_value"].get_extra_info("socket")
            if self._aborted:
                raise httpx.ConnectError("aborted")

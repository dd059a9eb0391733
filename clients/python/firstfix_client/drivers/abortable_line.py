"""A connection that another thread can cut while it is waited on."""

from __future__ import annotations

import socket
import threading
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import httpx

# What httpcore tells of when there is a socket, plain or through a proxy, and when TLS is put over it.
_CONNECTED = ("connect_tcp.complete", "connect_unix_socket.complete", "start_tls.complete")


class AbortableLine:
    """One connection at most, of one query at a time.

    httpx cannot be told to give up a request of another thread; but a socket that is shut down ends every
    wait for it, and a service sees that the caller has hung up.

    Args:
        http: of its own, with room for one connection.
    """

    def __init__(self, http: httpx.Client) -> None:
        self._http = http
        self._lock = threading.Lock()
        self._socket: socket.socket | None = None
        self._aborted = False

    def send(self, request: httpx.Request, *, stream: bool = False) -> httpx.Response:
        """
        Raises:
            httpx.TransportError: no answer, or it was aborted.
        """
        request.extensions = {**request.extensions, "trace": self._on_trace}
        return self._http.send(request, stream=stream)

    def abort(self) -> None:
        """Ends what is being sent. The line is of no use afterwards."""
        with self._lock:
            self._aborted = True
            if self._socket is not None:
                with suppress(OSError):  # the other side was faster
                    self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self._http.close()

    def _on_trace(self, event: str, info: Mapping[str, Any]) -> None:
        if not event.endswith(_CONNECTED):
            return
        with self._lock:
            self._socket = info["return_value"].get_extra_info("socket")
            if self._aborted:
                raise httpx.ConnectError("aborted")

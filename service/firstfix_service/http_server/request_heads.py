"""Heads of requests: uvicorn's protocol, with limits for their size and the number of their headers."""

from __future__ import annotations

from typing import Any, Never
from urllib.parse import unquote

import httptools
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

from ..limits.limits import Limits

TOO_LARGE = (b"431 Request Header Fields Too Large", "request header fields too large")


class _Refusal(Exception):
    """Stops the parser at a request that exceeds a limit."""


class RequestHeads(HttpToolsProtocol):
    """A connection whose caller may send too long a head.

    Attributes:
        refusal: status and text for the request at which the parser was stopped; None: it was not.
    """

    def __init__(self, *args: Any, limits: Limits, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.limits = limits
        self._asgi_version = self.config.asgi_version
        self.refusal: tuple[bytes, str] | None = None
        self._head_bytes = self._headers = 0
        self._is_in_head = True

    # Called by the parser

    def on_message_begin(self) -> None:
        """Start the head of a request."""
        self.url, self.headers, self.expect_100_continue = b"", [], False
        self.scope = {  # type: ignore[typeddict-item]  # the rest comes with the whole head
            "type": "http",
            "asgi": {"version": self._asgi_version, "spec_version": "2.3"},
            "http_version": "1.1",
            "server": self.server,
            "client": self.client,
            "scheme": self.scheme,  # type: ignore[typeddict-item]
            "root_path": self.root_path,
            "headers": self.headers,
            "state": self.app_state.copy(),
        }
        self._head_bytes = self._headers = 0
        self._is_in_head = True

    def on_url(self, url: bytes) -> None:
        """Count the URL as part of the head."""
        self._head_bytes += len(url)
        if self._head_bytes > self.limits.max_head_bytes:
            self.stop_parsing(*TOO_LARGE)
        self.url += url

    def on_header(self, name: bytes, value: bytes) -> None:
        """Count a header as part of the head."""
        self._headers += 1
        self._head_bytes += len(name) + len(value) + 4
        if self._head_bytes > self.limits.max_head_bytes or self._headers > self.limits.max_headers:
            self.stop_parsing(*TOO_LARGE)
        if self._is_in_head:  # otherwise it is a trailer, which is ignored
            name = name.lower()
            if name == b"expect" and value.lower() == b"100-continue":
                self.expect_100_continue = True
            self.headers.append((name, value))

    def complete_scope(self) -> Any:
        """The ASGI scope of a request whose whole head has come."""
        self._is_in_head = False
        parser, scope, target = self.parser, self.scope, httptools.parse_url(self.url)
        path = target.path.decode("ascii")
        scope["method"], scope["http_version"] = (
            parser.get_method().decode("ascii"),
            parser.get_http_version(),
        )
        scope["path"], scope["raw_path"] = unquote(path) if "%" in path else path, target.path
        scope["query_string"] = target.query or b""
        return scope

    def stop_parsing(self, status: bytes, text: str) -> Never:
        """Stop the parser, which then asks for ``send_400_response``: refuse the request so."""
        self.refusal = (status, text)
        raise _Refusal

    def write_refusal(self, status: bytes, text: str) -> None:
        """Send a refusal in plain text, after which the connection closes."""
        self.transport.write(
            b"HTTP/1.1 %s\r\ncontent-type: text/plain\r\nconnection: close\r\ncontent-length: %d\r\n\r\n%s"
            % (status, len(text), text.encode())
        )

"""A small server that speaks as much of S3 as a store needs, and honours If-None-Match or does not."""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from email.utils import formatdate
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Literal
from urllib.parse import parse_qs, unquote, urlsplit
from xml.etree import ElementTree
from xml.sax.saxutils import escape

BUCKET = "maps"
# Answers to a put with If-None-Match: as S3 has it; as if it had no such header; or an error, always.
Way = Literal["honours", "ignores", "501", "400", "405", "403", "412", "503"]
CODES = {
    "501": "NotImplemented",
    "400": "InvalidArgument",
    "405": "MethodNotAllowed",
    "403": "AccessDenied",
    "412": "PreconditionFailed",
    "503": "SlowDown",
}


class StandIn:
    """The objects of the server, and the requests that it was sent.

    Attributes:
        url: of the store in it.
    """

    def __init__(self, way: Way, port: int) -> None:
        self.way = way
        self.objects: dict[str, bytes] = {}
        self.asked: list[str] = []
        self.lock = threading.Lock()
        self.url = (
            f"s3://{BUCKET}/p?endpoint=http://127.0.0.1:{port}&region=x&allow_http=true&skip_signature=true"
        )

    def put(self, key: str, data: bytes, is_create_only: bool) -> int:
        with self.lock:
            if is_create_only and self.way not in ("ignores", "honours"):
                return int(self.way)
            if is_create_only and self.way == "honours" and key in self.objects:
                return 412
            self.objects[key] = data
            return 200


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    store: StandIn

    def do_PUT(self) -> None:
        data = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        status = self.store.put(self._key, data, self.headers.get("If-None-Match") == "*")
        self._answer(status, b"", data)

    def do_GET(self) -> None:
        if "list-type" in parse_qs(urlsplit(self.path).query):
            self._answer(200, self._listing())
        elif self._key in self.store.objects:
            self._answer(200, self.store.objects[self._key])
        else:
            self._answer(404, b"")

    def do_HEAD(self) -> None:
        self.do_GET()

    def do_POST(self) -> None:
        """Deletes the objects that the body names, as ``POST /BUCKET?delete`` does."""
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        keys = [one.text or "" for one in ElementTree.fromstring(body).iter() if one.tag.endswith("Key")]
        with self.store.lock:
            for key in keys:
                self.store.objects.pop(key, None)
        deleted = "".join(f"<Deleted><Key>{escape(key)}</Key></Deleted>" for key in keys)
        self._answer(200, f"<DeleteResult>{deleted}</DeleteResult>".encode())

    @property
    def _key(self) -> str:
        return unquote(urlsplit(self.path).path.removeprefix(f"/{BUCKET}/"))

    def _listing(self) -> bytes:
        query = parse_qs(urlsplit(self.path).query)
        prefix = query.get("prefix", [""])[0]
        found = sorted(key for key in self.store.objects if key.startswith(prefix))
        items = "".join(
            f"<Contents><Key>{escape(key)}</Key><Size>{len(self.store.objects[key])}</Size>"
            "<LastModified>2026-01-01T00:00:00.000Z</LastModified><ETag>x</ETag></Contents>"
            for key in found
        )
        return f"<ListBucketResult>{items}<IsTruncated>false</IsTruncated></ListBucketResult>".encode()

    def _answer(self, status: int, body: bytes, data: bytes | None = None) -> None:
        self.store.asked.append(f"{self.command} {status}")
        content = body if data is None else data
        if status >= 400 and str(status) in CODES:
            body = f"<Error><Code>{CODES[str(status)]}</Code><Message>no</Message></Error>".encode()
        self.send_response(status)
        self.send_header("ETag", f'"{hashlib.md5(content, usedforsecurity=False).hexdigest()}"')
        self.send_header("Last-Modified", formatdate(usegmt=True))
        if status != 204:
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def s3_stand_in(way: Way) -> Iterator[StandIn]:
    """A server with an empty bucket."""

    class Handler(_Handler):
        pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    Handler.store = StandIn(way, server.server_port)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
    thread.start()
    try:
        yield Handler.store
    finally:
        server.shutdown()
        server.server_close()
        thread.join()

"""Sources by HTTP, from a real server on loopback that breaks and lies on demand."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from firstfix.builds.options import BuildOptions
from firstfix.errors import BuildFailed, InvalidOption, NotFound, TooLarge
from firstfix.store.store import Store
from firstfix_builder.job import fetch_http as module
from firstfix_builder.job.fetch_http import fetch_http
from firstfix_builder.job.fetch_source import SourceFetch

DATA = bytes(range(256)) * 500
Answer = Callable[[BaseHTTPRequestHandler], None]


class Server:
    """Answers in turn, the last one again and again; keeps the requests' headers."""

    def __init__(self) -> None:
        self.answers: list[Answer] = []
        self.asked: list[dict[str, str]] = []
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                outer.asked.append({name.lower(): value for name, value in self.headers.items()})
                (outer.answers.pop(0) if len(outer.answers) > 1 else outer.answers[0])(self)

            def log_message(self, *_: object) -> None:
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self.http.server_port}/maps/hall.ply"
        threading.Thread(target=self.http.serve_forever, daemon=True).start()


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    monkeypatch.setattr(module, "PAUSE_S", 0.01)
    running = Server()
    yield running
    running.http.shutdown()
    running.http.server_close()


def fetched(server: Server, folder: Path, **options: Any) -> Path:
    store = Store.open("memory://")
    fetch = SourceFetch(BuildOptions(build_id="b1", work=folder, **options), store, "hall")
    return fetch.fetch({"url": server.url}, "hall.ply")


def says(status: int, body: bytes = b"", length: int | None = None, **headers: str) -> Answer:
    """Length: what is claimed; a longer one than the body is a connection that breaks."""

    def answer(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(status)
        for name, value in headers.items():
            handler.send_header(name.replace("_", "-"), value)
        handler.send_header("Content-Length", str(len(body) if length is None else length))
        handler.end_headers()
        handler.wfile.write(body)

    return answer


def test_a_file_arrives(server: Server, tmp_path: Path):
    server.answers = [says(200, DATA)]
    path = fetched(server, tmp_path, source_urls=(server.url.rsplit("/", 1)[0],))
    assert path.read_bytes() == DATA
    assert path.suffix == ".ply"
    assert server.asked[0]["accept-encoding"] == "identity"


def test_progress_of_a_fetch_is_told(server: Server, tmp_path: Path):
    server.answers = [says(200, DATA)]
    told: list[float] = []
    fetch_http(server.url, tmp_path / "a", 1 << 20, told.append)
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_a_connection_that_breaks_is_gone_on_with(server: Server, tmp_path: Path):
    rest = says(206, DATA[1000:], ETag='"1"', Content_Range=f"bytes 1000-{len(DATA) - 1}/{len(DATA)}")
    server.answers = [says(200, DATA[:1000], len(DATA), ETag='"1"'), says(503), rest]
    fetch_http(server.url, tmp_path / "a", 1 << 20)
    assert (tmp_path / "a").read_bytes() == DATA
    assert [asked.get("range") for asked in server.asked] == [None, "bytes=1000-", "bytes=1000-"]
    assert server.asked[1]["if-range"] == '"1"'


def test_another_file_in_between_starts_anew(server: Server, tmp_path: Path):
    server.answers = [says(200, b"x" * 1000, 2000, ETag='"1"'), says(200, DATA, ETag='"2"')]
    fetch_http(server.url, tmp_path / "a", 1 << 20)
    assert (tmp_path / "a").read_bytes() == DATA


def test_without_an_etag_nothing_is_pieced_together(server: Server, tmp_path: Path):
    server.answers = [says(200, DATA[:1000], len(DATA)), says(200, DATA)]
    fetch_http(server.url, tmp_path / "a", 1 << 20)
    assert (tmp_path / "a").read_bytes() == DATA
    assert "range" not in server.asked[1]


@pytest.mark.parametrize(
    ("answer", "error", "says_why"),
    [
        (says(404), NotFound, "nothing"),
        (says(403), BuildFailed, "403"),
        (says(302, Location="http://169.254.169.254/latest/meta-data"), BuildFailed, "redirects"),
        (says(500), BuildFailed, "500"),
        (says(200, DATA, len(DATA) + 1), BuildFailed, "cannot be fetched from its server"),
        (says(200, b"", 1 << 30), TooLarge, "limit"),
        (says(206, DATA, Content_Range="bytes 7-9/10"), BuildFailed, "206"),
    ],
)
def test_a_source_that_cannot_be_fetched_leaves_no_file(
    server: Server, tmp_path: Path, answer: Answer, error: type[Exception], says_why: str
):
    server.answers = [answer]
    with pytest.raises(error, match=says_why):
        fetch_http(server.url, tmp_path / "a", 1 << 20)
    assert list(tmp_path.iterdir()) == []


def test_a_body_that_does_not_say_its_length_is_stopped_at_the_limit(server: Server, tmp_path: Path):
    def endless(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(200)
        handler.end_headers()
        try:
            while True:
                handler.wfile.write(bytes(1 << 16))
        except OSError:
            return

    server.answers = [endless]
    with pytest.raises(TooLarge):
        fetched(server, tmp_path, max_source_bytes=1 << 20, source_urls=(server.url,))


def test_only_where_the_operator_allows(server: Server, tmp_path: Path):
    for urls in ((), ("https://elsewhere.example.org/",)):
        with pytest.raises(InvalidOption, match="not allowed"):
            fetched(server, tmp_path, source_urls=urls)
    assert server.asked == []


def test_a_refused_connection_fails_the_build(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "PAUSE_S", 0.01)
    with pytest.raises(BuildFailed, match="cannot be fetched from its server"):
        fetch_http("http://127.0.0.1:9/x", tmp_path / "a", 100)

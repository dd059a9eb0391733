"""The console's page over HTTP: its files, their headers, and names that lead nowhere."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from firstfix_console import page as console_page
from tests.service.raw_connection import all_of, connect
from tests.service.service_world import Service, running_service

SCRIPT = b"export const answer = 42;" * 100
FILES = {
    "index.html": b'<script type="module" src="./assets/index-a1.js"></script>',
    "icon.svg": b"<svg/>",
    "assets/index-a1.js": SCRIPT,
    "assets/index-b2.css": b"body {}",
}


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> dict[str, console_page.PageFile]:
    folder = tmp_path_factory.mktemp("page")
    for name, content in FILES.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_bytes(content)
    return console_page.read_page(folder)


@pytest.fixture(scope="module")
def closed(
    page: dict[str, console_page.PageFile], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Service]:
    """A service that asks for keys."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(console_page, "page_files", lambda: page)
        folder = tmp_path_factory.mktemp("service")
        with running_service(folder, auth="on", keys_refresh_s=0.1, zenoh=False) as running:
            yield running


@pytest.mark.parametrize("path", ["/", "/console"])
def test_the_root_leads_to_the_page_whatever_its_prefix(closed: Service, path: str):
    answer = closed.http.get(path)
    assert answer.status_code == 307
    assert answer.headers["location"] == "console/", "relative, so no host and no prefix is in it"


@pytest.mark.parametrize(
    ("path", "name", "media_type"),
    [
        ("/console/", "index.html", "text/html; charset=utf-8"),
        ("/console/index.html", "index.html", "text/html; charset=utf-8"),
        ("/console/icon.svg", "icon.svg", "image/svg+xml"),
        ("/console/assets/index-a1.js", "assets/index-a1.js", "text/javascript; charset=utf-8"),
        ("/console/assets/index-b2.css", "assets/index-b2.css", "text/css; charset=utf-8"),
    ],
)
def test_everybody_gets_the_files(closed: Service, path: str, name: str, media_type: str):
    answer = closed.http.get(path)
    assert answer.status_code == 200
    assert answer.content == FILES[name]
    assert answer.headers["content-type"] == media_type
    assert answer.headers["x-content-type-options"] == "nosniff"
    caching = answer.headers["cache-control"]
    assert caching == ("private, max-age=31536000, immutable" if "assets" in name else "no-cache")


def test_the_page_may_load_and_ask_nothing_but_this_service(closed: Service):
    policy = closed.http.get("/console/").headers["content-security-policy"]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    assert {rules[name] for name in ("script-src", "style-src", "connect-src")} == {"'self'"}
    assert {rules[name] for name in ("frame-ancestors", "base-uri", "form-action")} == {"'none'"}
    assert "unsafe" not in policy
    assert ":/" not in policy


@pytest.mark.parametrize(
    ("accepted", "is_packed"),
    [
        ("gzip", True),
        ("br, gzip;q=0.5", True),
        ("GZIP", True),
        ("*", True),
        ("gzip;q=0", False),
        ("gzip;q=0.000, *", False),
        ("identity", False),
        ("x-notgzip", False),
        ("", False),
    ],
)
def test_it_comes_packed_to_those_who_take_it(closed: Service, accepted: str, is_packed: bool):
    asked = {"Accept-Encoding": accepted}
    with closed.http.stream("GET", "/console/assets/index-a1.js", headers=asked) as answer:
        raw = b"".join(answer.iter_raw())
    assert answer.headers.get("content-encoding") == ("gzip" if is_packed else None)
    assert answer.headers["vary"] == "Accept-Encoding"
    assert (gzip.decompress(raw) if is_packed else raw) == SCRIPT
    assert int(answer.headers["content-length"]) == len(raw)


@pytest.mark.parametrize("path", ["/", "/console", "/console/", "/console/assets/index-a1.js"])
def test_a_head_has_the_headers_alone(closed: Service, path: str):
    got, head = closed.http.get(path), closed.http.head(path)
    assert head.status_code == got.status_code
    assert head.content == b""
    for name in ("content-type", "content-length", "cache-control", "location"):
        assert head.headers.get(name) == got.headers.get(name)


NOWHERE = [
    b"/console/../healthz",
    b"/console/../../../../etc/passwd",
    b"/console/..",
    b"/console/.",
    b"/console/%2e%2e/%2e%2e/settings.py",
    b"/console/..%2f..%2fapp.py",
    b"/console/..%5c..%5capp.py",
    b"/console/assets",
    b"/console/assets/",
    b"/console/assets/../index.html",
    b"/console//index.html",
    b"/console//etc/passwd",
    b"/console/%00",
    b"/console/index.html%00",
    b"/console/index.html%0d%0aX-Injected:%201",
    b"/console/INDEX.HTML",
    b"/console/index.html%20",
    b"/console/%ff%fe",
    b"/console/\xff",
    b"/console/<script>alert(1)</script>",
    b"/console/" + b"a" * 30_000,
    b"/console/" + b"%2e%2e/" * 4000,
    b"/Console/",
    b"/maps/..",
]


@pytest.mark.parametrize("path", NOWHERE, ids=lambda path: repr(path[:40]))
def test_names_that_are_none_lead_nowhere(closed: Service, path: bytes):
    with connect(closed) as connection:
        connection.sendall(b"GET " + path + b" HTTP/1.1\r\nHost: h\r\nConnection: close\r\n\r\n")
        head, _, body = all_of(connection).partition(b"\r\n\r\n")
    status = int(head.split(b" ", 2)[1])
    assert 400 <= status < 500, head
    assert b"x-injected" not in head.lower()
    assert b"location" not in head.lower()
    assert b"alert(1)" not in body
    assert b"root:" not in body
    assert len(body) < 2000


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_can_be_put_there(closed: Service, method: str):
    for path in ("/", "/console", "/console/", "/console/new.html"):
        assert closed.http.request(method, path, content=b"x").status_code == 405


ASKED_FOR_A_KEY = [
    "/caller",
    "/sensors",
    "/recorded-queries",
    "/recorded-queries/20260101t000000000000-00000000/body",
    "/keys",
    "/answers/counts",
    "/answers/events",
    "/maps",
    f"/maps/hall/versions/{'0' * 64}/cloud",
    f"/maps/hall/versions/{'0' * 64}/cloud/points?first=0&count=1",
]


@pytest.mark.parametrize("path", ASKED_FOR_A_KEY)
def test_the_page_is_public_and_what_it_shows_is_not(closed: Service, path: str):
    assert closed.http.get(path).status_code == 401
    assert closed.http.get(path, headers={"Authorization": "Bearer nonsense"}).status_code == 401


def test_every_answer_keeps_its_type(closed: Service):
    for path in ("/healthz", "/maps", "/openapi.json", "/nowhere"):
        assert closed.http.get(path).headers["x-content-type-options"] == "nosniff"


def test_it_can_be_switched_off(tmp_path: Path):
    with running_service(tmp_path, console=False, zenoh=False) as service:
        for path in ("/", "/console", "/console/", "/console/index.html"):
            assert service.http.get(path).status_code == 404
        assert service.http.get("/maps").status_code == 200


def test_an_installation_without_a_page_says_so(
    closed: Service, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(console_page, "page_files", lambda: console_page.read_page(tmp_path / "none"))
    for path in ("/", "/console/"):
        answer: httpx.Response = closed.http.get(path)
        assert answer.status_code == 404
        assert "make console" in answer.json()["detail"]

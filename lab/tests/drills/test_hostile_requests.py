"""Hostile requests: each is answered, none with 5xx by a defect, and memory stays bounded."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.decode import decode_query
from firstfix.errors import InputError
from firstfix.wire.content_encoding import undo_content_encoding
from firstfix_lab.drills.fuzz_bodies import Ask, fuzz, http_asker, zenoh_asker
from tests.hostile_bodies import Body, damaged, good_bodies
from tests.service.service_world import SCAN_BODY, XYZ, Service, publish, running_service

BODIES_PER_ENCODING = 60  # lab/firstfix_lab/drills/fuzz_bodies.py sends 1,000
MAX_GROWTH_BYTES = 300_000_000  # with the client in the same process; the benchmark holds 200 MB without
HEADERS = {"Content-Type": XYZ}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """One service for all: a hostile request must not harm the next one."""
    with running_service(tmp_path_factory.mktemp("service")) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        yield running


@pytest.fixture(scope="module")
def large_bodies() -> list[Body]:
    return good_bodies(points=100_000)


def asker(service: Service, transport: str) -> Ask:
    return http_asker(service.http, "hall") if transport == "http" else zenoh_asker(service.session, "hall")


def memory_bytes(name: str) -> int:
    """Returns VmRSS, or its peak VmHWM."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 for line in lines if line.startswith(f"{name}:"))


def outcome_of(data: bytes | memoryview, body: Body) -> tuple[str, bytes]:
    """Returns the points of a body, or its error."""
    try:
        plain = undo_content_encoding(data, body.content_encoding or "", 1 << 20)
        scan = decode_query(plain, body.media_type)
    except InputError as error:
        return f"{type(error).__name__}: {error}", b""
    points = getattr(getattr(scan, "scans", [scan])[-1], "points", np.empty(0))
    return type(scan).__name__, points.tobytes()


def test_a_view_of_memory_is_read_as_bytes_are():
    """Workers read long bodies where the service wrote them, which is followed by older ones."""
    for body in good_bodies():
        for data in [body.data, *(damaged(body, np.random.default_rng(s)).data for s in range(20))]:
            memory = memoryview(data + bytes(range(256))).toreadonly()
            assert outcome_of(memory[: len(data)], body) == outcome_of(data, body)


def test_damage_is_done_and_repeats():
    for body in good_bodies():
        first, again = ([damaged(body, np.random.default_rng(s)) for s in range(20)] for _ in range(2))
        assert first == again
        assert len({one.data for one in first}) > 15


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_every_body_is_answered_within_the_memory(service: Service, large_bodies: list[Body], transport: str):
    ask = asker(service, transport)
    for body in [*good_bodies(), *large_bodies]:
        assert ask(body) == 200
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before = memory_bytes("VmRSS")
    outcome = fuzz(ask, BODIES_PER_ENCODING)
    assert outcome.wrong == []
    assert sum(outcome.statuses.values()) > BODIES_PER_ENCODING * len(good_bodies())
    assert outcome.statuses[400] > 100
    assert memory_bytes("VmHWM") - before < MAX_GROWTH_BYTES


PATHS = [
    "/maps/%2e%2e",
    "/maps/%2e%2e%2f%2e%2e%2fetc%2fpasswd",
    "/maps/..%2f..%2fkeys",
    "/maps/%00",
    "/maps/hall%00",
    "/maps/hall%0d%0aX-Injected:%201",
    "/maps/hall/versions/%00/activate",
    "/maps/" + "a" * 30_000,
    "/maps/%ff%fe",
    "/maps/HALL",
    "/maps/hall%20",
    "/maps/\uff48\uff41ll",
    "/builds/%2e%2e%2fkeys",
    "/builds/..%5c..",
    "/builds/%00",
    "/builds/" + "b" * 30_000,
    "//maps/hall",
    "/maps//hall",
    "/%2fmaps/hall",
]


@pytest.mark.parametrize("method", ["GET", "POST", "DELETE"])
def test_names_that_are_none_lead_nowhere(service: Service, method: str):
    for path in PATHS:
        answer = service.http.request(method, path)
        assert 400 <= answer.status_code < 500, path[:40]
        assert answer.headers["content-type"] == "application/problem+json", path[:40]
        assert "x-injected" not in answer.headers
        assert len(answer.content) < 2000
        assert "location" not in answer.headers


QUERIES = [
    "map=../hall",
    "map=hall%00",
    "map=" + "hall," * 5000,
    "map=hall&version=../../x",
    "map=hall&version=" + "0" * 30_000,
    "map=hall&prior=nan,0,0,1",
    "map=hall&prior=0,0,0,inf",
    "map=hall&prior=1e400,0,0,1",
    "map=hall&gravity=0,0,0",
    "map=hall&gravity=1e308,1e308,1e308",
    "map=hall&T_base_sensor=0,0,0,0,0,0,0",
    "map=hall&T_base_sensor=1e308,0,0,1e308,0,0,1",
    "map=hall&T_base_sensor=" + "1," * 10_000,
    "map=hall&max_candidates=1e9",
    "map=hall&max_candidates=-0",
    "map=hall&max_candidates=9" + "9" * 5000,
    "map=hall&deadline_ms=0",
    "map=hall&deadline_ms=nan",
    "map=hall&min_probability=-1e-400,1",
    "map=hall&" + "&".join(f"o{n}=1" for n in range(3000)),
    "map=hall&%00=1",
    "map=hall&%ff=%fe",
]


def test_options_that_are_none_are_refused(service: Service):
    for query in QUERIES:
        answer = service.http.post(f"/localize?{query}", content=SCAN_BODY, headers=HEADERS)
        assert 400 <= answer.status_code < 500, query[:40]
        assert len(answer.content) < 2000, "what was sent is not sent back at length"


@pytest.mark.parametrize("given", ["a\tb", "a b", "", "x" * 65, '{"a": 1}', "\xe9"])
def test_a_request_id_is_taken_only_when_it_is_harmless(service: Service, given: str):
    answer = service.http.get("/healthz", headers={"X-Request-Id": given.encode("latin-1")})
    assert answer.headers["x-request-id"] != given
    assert len(answer.headers["x-request-id"]) == 32


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Content-Type": "a" * 5000}, 415),
        ({"Content-Type": "\xff\xfe"}, 415),
        ({"Content-Encoding": "gzip, gzip"}, 415),
        ({"Content-Encoding": "gzip," * 1000}, 415),
        ({"Content-Encoding": "\xff"}, 415),
        ({"Content-Encoding": "deflate"}, 415),
    ],
)
def test_headers_that_are_none_are_refused(service: Service, headers: dict[str, str], status: int):
    sent = {name: value.encode("latin-1") for name, value in {**HEADERS, **headers}.items()}
    answer = service.http.post("/localize?map=hall", content=SCAN_BODY, headers=sent)
    assert answer.status_code == status
    assert len(answer.content) < 2000


def deep(depth: int) -> str:
    return '{"a":' * depth + "1" + "}" * depth


@pytest.mark.parametrize(
    "body",
    [
        deep(100_000),
        "[" * 900_000,
        '{"map_id": ' + "[" * 100_000,
        '{"map_id": "hall", "source": {"url": "s3://b/x"}, "config": ' + deep(50_000) + "}",
        '{"map_id": "hall", "source": {"url": "s3://b/\\u0000x"}}',
        '{"map_id": "hall\\u0000", "source": {"url": "s3://b/x"}}',
        '{"map_id": "../hall", "source": {"url": "s3://b/x"}}',
        '{"map_id": ["hall"], "source": {"url": "s3://b/x"}}',
        '{"map_id": "hall", "source": {"url": ' + "9" * 5000 + "}}",
        '{"map_id": "hall", "source": {"url": 1e999}}',
        "\ud800",
        "null",
        "",
        "{" + ",".join(f'"k{n}": 1' for n in range(60_000)) + "}",
        "9" * 900_000,
    ],
    ids=lambda body: body[:30] or "empty",
)
def test_json_that_is_meant_to_hurt_is_refused(service: Service, body: str):
    data = body.encode("utf-8", "surrogatepass")
    answer = service.http.post("/maps", content=data, headers={"Content-Type": "application/json"})
    assert 400 <= answer.status_code < 500
    assert len(answer.content) < 2000
    assert service.catalog.builds.ids() == []


def form(*parts: bytes, boundary: bytes = b"B") -> bytes:
    return (
        b"".join(b"--" + boundary + b"\r\n" + part + b"\r\n" for part in parts) + b"--" + boundary + b"--\r\n"
    )


def field(name: bytes, value: bytes, more: bytes = b"") -> bytes:
    return b'Content-Disposition: form-data; name="' + name + b'"' + more + b"\r\n\r\n" + value


MAP = field(b"map_id", b"hall")
FORMS = {
    "a deep config": form(MAP, field(b"config", deep(100_000).encode())),
    "a null in the id": form(field(b"map_id", b"hall\x00")),
    "an id that climbs": form(field(b"map_id", b"../../keys")),
    "an id that is no text": form(field(b"map_id", b"\xff\xfe")),
    "a field twice": form(MAP, MAP),
    "a field of no name": form(b"\r\nhall"),
    "a name that climbs": form(MAP, field(b"../source", b"x", b'; filename="a.ply"')),
    "a long text": form(field(b"map_id", b"a" * (2 << 20))),
    "long headers": form(b"X-A: " + b"b" * 100_000 + b"\r\n\r\nx"),
    "many headers": form(b"X-A: b\r\n" * 10_000 + b"\r\nx"),
    "many fields": form(*[field(b"x%d" % n, b"y") for n in range(5000)]),
    "no end": form(MAP)[:-6],
    "no boundary in it": b"hall" * 1000,
    "nothing": b"",
}


@pytest.mark.parametrize("kind", FORMS)
def test_forms_that_are_meant_to_hurt_are_refused(service: Service, kind: str):
    headers, before = {"Content-Type": "multipart/form-data; boundary=B"}, service.catalog.builds.ids()
    answer = service.http.post("/maps", content=FORMS[kind], headers=headers)
    assert 400 <= answer.status_code < 500
    assert len(answer.content) < 2000
    assert service.catalog.builds.ids() == before
    assert list((service.settings.work_dir / "uploads").iterdir()) == [], "nothing stays on the disk"


@pytest.mark.parametrize(
    "content_type",
    ["multipart/form-data", "multipart/form-data; boundary=", "multipart/form-data; boundary=" + "B" * 30_000]
    + [
        'multipart/form-data; boundary="B',
        "multipart/form-data; " + "a=b;" * 5000,
        "multipart/form-data; boundary=\xff",
    ],
)
def test_boundaries_that_are_none_are_refused(service: Service, content_type: str):
    headers = {"Content-Type": content_type.encode("latin-1")}
    answer = service.http.post("/maps", content=form(MAP), headers=headers)
    assert 400 <= answer.status_code < 500
    assert len(answer.content) < 2000


@pytest.mark.parametrize(
    "file_name",
    [
        b"../../etc/passwd.ply",
        b"..\\..\\x.ply",
        b"/etc/x.ply",
        b"a\x00b.ply",
        b".ply",
        b"",
        b"\xff.ply",
        b"a" * 500 + b".ply",
    ]
    + [b"a;b`c$(d).ply", b"con.ply", b"\xe2\x80\xae.ply"],
)
def test_file_names_are_made_harmless(service: Service, file_name: bytes):
    body = form(MAP, field(b"source", b"x y z", b'; filename="' + file_name + b'"'))
    headers = {"Content-Type": "multipart/form-data; boundary=B"}
    answer = service.http.post("/maps", content=body, headers=headers)
    assert answer.status_code == 202
    kept = service.catalog.builds.request(answer.json()["build_id"])["file_name"]
    assert 0 < len(kept) <= 100
    assert not kept.startswith(".")
    assert set(kept) <= set("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-")

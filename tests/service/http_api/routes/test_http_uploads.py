"""Resumable uploads over HTTP, interrupted at every place where a connection can break."""

from __future__ import annotations

import base64
import hashlib
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firstfix.catalog.uploads.parts import PART_BYTES
from tests.service.service_world import Service, running_service
from tests.waiting import wait_until

PART = {"Content-Type": "application/offset+octet-stream"}
DATA = bytes(range(256)) * 100


@pytest.fixture(scope="module")
def shared() -> Iterator[Service]:
    """One service for the tests that leave nothing behind."""
    with (
        tempfile.TemporaryDirectory() as directory,
        running_service(
            Path(directory), zenoh=False, max_open_uploads=10_000, max_open_uploads_per_caller=10_000
        ) as service,
    ):
        yield service


def b64(data: bytes) -> str:
    return base64.b64encode(data).decode()


def begin(service: Service, size: int = len(DATA), name: str = "hall.xyz", sha256: str | None = None) -> str:
    metadata = f"filename {b64(name.encode())}"
    if sha256 is not None:
        metadata += f",sha256 {b64(sha256.encode())}"
    response = service.http.post(
        "/uploads",
        headers={"Upload-Length": str(size), "Upload-Metadata": metadata, "Tus-Resumable": "1.0.0"},
    )
    assert response.status_code == 201, response.text
    return response.headers["location"]


def send(service: Service, url: str, offset: int, data: bytes, **headers: str) -> httpx.Response:
    return service.http.patch(url, content=data, headers={**PART, "Upload-Offset": str(offset), **headers})


def offset_of(service: Service, url: str) -> int:
    response = service.http.head(url)
    assert response.status_code == 200
    assert response.headers["cache-control"] == "no-store"
    return int(response.headers["upload-offset"])


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    data=st.binary(min_size=1, max_size=2000),
    cuts=st.lists(st.integers(0, 2000), max_size=5),
    wrong=st.integers(1, 5000),
)
def test_however_a_file_is_cut_it_arrives(shared: Service, data: bytes, cuts: list[int], wrong: int):
    url = begin(shared, len(data), sha256=hashlib.sha256(data).hexdigest())
    for end in [*sorted(cut for cut in cuts if cut < len(data)), len(data)]:
        offset = offset_of(shared, url)
        refused = send(shared, url, offset + wrong, b"x")
        assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
        response = send(shared, url, offset, data[offset:end])
        assert response.status_code == 204
        assert int(response.headers["upload-offset"]) == end
    assert shared.http.get(url).json()["complete"]
    answer = shared.http.post("/maps", json={"map_id": "hall", "source": {"upload": url.split("/")[-1]}})
    assert answer.status_code == 202, answer.text
    request = shared.catalog.builds.request(answer.json()["build_id"])
    assert shared.catalog.store.get(request["source"]["key"]) == data
    assert request["file_name"] == "hall.xyz"
    assert shared.http.delete(url).status_code == 204
    assert shared.http.head(url).status_code == 404


def test_a_connection_that_breaks_costs_nothing_that_arrived(shared: Service):
    size = PART_BYTES + 5000
    url = begin(shared, size)
    address = urlsplit(shared.url)
    with socket.create_connection((str(address.hostname), int(address.port or 0))) as connection:
        head = (
            f"PATCH {url} HTTP/1.1\r\nHost: x\r\nContent-Type: {PART['Content-Type']}\r\n"
            f"Upload-Offset: 0\r\nContent-Length: {size}\r\n\r\n"
        )
        connection.sendall(head.encode() + bytes(PART_BYTES + 1000))
    wait_until(lambda: offset_of(shared, url) == PART_BYTES + 1000)
    assert send(shared, url, PART_BYTES + 1000, bytes(4000)).status_code == 204
    assert shared.http.get(url).json()["complete"]


def test_an_upload_goes_on_after_a_restart_and_on_another_replica(tmp_path: Path):
    store = str(tmp_path / "store")
    with running_service(tmp_path / "a", zenoh=False, store=store) as first:
        url = begin(first)
        send(first, url, 0, DATA[:1000])
    with (
        running_service(tmp_path / "a", zenoh=False, store=store) as first,
        running_service(tmp_path / "b", zenoh=False, store=store) as second,
    ):
        assert send(second, url, 1000, DATA[1000:2000]).status_code == 204
        assert send(first, url, 2000, DATA[2000:]).status_code == 204
        body = {"map_id": "hall", "source": {"upload": url.split("/")[-1]}}
        build = second.http.post("/maps", json=body).json()["build_id"]
        key = first.catalog.builds.request(build)["source"]["key"]
        assert first.catalog.store.get(key) == DATA


def test_a_part_with_a_checksum_counts_as_a_whole_or_not_at_all(shared: Service):
    url = begin(shared)
    good = {"Upload-Checksum": f"sha256 {b64(hashlib.sha256(DATA[:100]).digest())}"}
    bad = {"Upload-Checksum": f"sha1 {b64(hashlib.sha1(b'other').digest())}"}
    refused = send(shared, url, 0, DATA[:100], **bad)
    assert (refused.status_code, refused.json()["code"]) == (460, "checksum_mismatch")
    assert offset_of(shared, url) == 0
    assert send(shared, url, 0, DATA[:100], **good).status_code == 204
    for header in ("md5 AAAA", "sha256 AAAA", "sha256 ***", ""):
        assert send(shared, url, 100, b"x", **{"Upload-Checksum": header}).status_code == 400
    assert offset_of(shared, url) == 100


def test_a_file_that_is_not_what_was_announced_is_removed(shared: Service):
    url = begin(shared, sha256="0" * 64)
    response = send(shared, url, 0, DATA)
    assert (response.status_code, response.json()["code"]) == (460, "checksum_mismatch")
    assert shared.http.head(url).status_code == 404


def test_more_than_was_announced_is_refused(shared: Service):
    url = begin(shared, 100)
    assert send(shared, url, 0, bytes(101)).status_code == 413
    assert offset_of(shared, url) == 0


def test_an_upload_that_is_not_complete_makes_no_map(shared: Service):
    url = begin(shared)
    send(shared, url, 0, DATA[:10])
    for upload, status in ((url.split("/")[-1], 409), ("never-was", 404), ("../x", 400)):
        answer = shared.http.post("/maps", json={"map_id": "hall", "source": {"upload": upload}})
        assert answer.status_code == status, answer.text


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({"Upload-Length": "0"}, 400),
        ({"Upload-Length": "-1"}, 400),
        ({"Upload-Length": "ten"}, 400),
        ({"Upload-Length": "9" * 18}, 413),
        ({"Upload-Metadata": ""}, 400),
        ({"Upload-Metadata": "filename"}, 400),
        ({"Upload-Metadata": "filename ***"}, 400),
        ({"Upload-Metadata": "filename /w=="}, 400),
        ({"Upload-Metadata": f"filename {b64(b'x')},filename {b64(b'x')}"}, 400),
        ({"Upload-Metadata": f"filename {b64(b'x')},sha256 {b64(b'short')}"}, 400),
        ({"Tus-Resumable": "2.0.0"}, 412),
    ],
)
def test_what_cannot_be_announced(shared: Service, headers: dict[str, str], status: int):
    good = {"Upload-Length": "10", "Upload-Metadata": f"filename {b64(b'x.ply')}"}
    before = shared.catalog.store.folders("uploads")
    response = shared.http.post("/uploads", headers={**good, **headers})
    assert response.status_code == status, response.text
    assert shared.catalog.store.folders("uploads") == before


def test_a_part_needs_its_media_type_and_offset(shared: Service):
    url = begin(shared)
    assert shared.http.patch(url, content=b"x", headers={"Upload-Offset": "0"}).status_code == 415
    assert shared.http.patch(url, content=b"x", headers=PART).status_code == 400
    assert send(shared, "/uploads/none", 0, b"x").status_code == 404


def test_the_protocol_describes_itself(shared: Service):
    headers = shared.http.options("/uploads").headers
    assert headers["tus-version"] == "1.0.0"
    assert set(headers["tus-extension"].split(",")) == {"creation", "checksum", "termination", "expiration"}
    assert headers["tus-max-size"] == str(shared.settings.max_upload_bytes)


def test_limits_on_number_and_disk(tmp_path: Path):
    with running_service(tmp_path / "a", zenoh=False, max_open_uploads=2) as service:
        for _ in range(2):
            begin(service)
        response = service.http.post(
            "/uploads", headers={"Upload-Length": "9", "Upload-Metadata": f"filename {b64(b'x')}"}
        )
        assert (response.status_code, response.json()["code"]) == (503, "overloaded")
    with running_service(tmp_path / "b", zenoh=False, min_free_bytes=1 << 60) as service:
        response = service.http.post(
            "/uploads", headers={"Upload-Length": "9", "Upload-Metadata": f"filename {b64(b'x')}"}
        )
        assert (response.status_code, response.json()["code"]) == (507, "out_of_space")
        response = service.http.post("/maps", data={"map_id": "hall"}, files={"source": ("a.xyz", DATA)})
        assert (response.status_code, response.json()["code"]) == (507, "out_of_space")
        assert list((service.settings.work_dir / "uploads").iterdir()) == []


def test_a_body_that_stalls_gives_its_place_back(tmp_path: Path):
    with running_service(tmp_path, zenoh=False, body_timeout_s=0.3, max_upload_streams=1) as service:
        url = begin(service)
        address = urlsplit(service.url)
        with socket.create_connection((str(address.hostname), int(address.port or 0))) as connection:
            head = (
                f"PATCH {url} HTTP/1.1\r\nHost: x\r\nContent-Type: {PART['Content-Type']}\r\n"
                f"Upload-Offset: 0\r\nContent-Length: {len(DATA)}\r\n\r\n"
            )
            connection.sendall(head.encode() + DATA[:700])
            assert b" 504 " in connection.recv(4096).split(b"\r\n")[0]
        assert offset_of(service, url) == 700

        def goes_on() -> bool:
            """Sends the rest. A busy machine may stall this body too, which is given up like the first."""
            offset = offset_of(service, url)
            return send(service, url, offset, DATA[offset:]).status_code == 204

        wait_until(goes_on)  # with a place that were not given back, it would never

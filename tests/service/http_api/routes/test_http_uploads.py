"""Resumable uploads over HTTP, interrupted at every place where a connection can break."""

from __future__ import annotations

import hashlib
from base64 import b64encode as encode
from pathlib import Path

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from firstfix.catalog.uploads.parts import PART_BYTES
from tests.service.raw_connection import connect
from tests.service.service_world import Service, running_service, serving
from tests.waiting import wait_until

pytestmark = serving(
    is_shared=True, zenoh=False, maps={}, max_open_uploads=10_000, max_open_uploads_per_caller=10_000
)
PART = {"Content-Type": "application/offset+octet-stream"}
DATA = bytes(range(256)) * 100


def b64encode(data: bytes) -> str:
    return encode(data).decode()


def patching(url: str, size: int) -> bytes:
    """The head of a part."""
    head = f"PATCH {url} HTTP/1.1\r\nHost: x\r\nContent-Type: {PART['Content-Type']}\r\n"
    return f"{head}Upload-Offset: 0\r\nContent-Length: {size}\r\n\r\n".encode()


def begin(service: Service, size: int = len(DATA), name: str = "hall.xyz", sha256: str | None = None) -> str:
    metadata = f"filename {b64encode(name.encode())}"
    if sha256 is not None:
        metadata += f",sha256 {b64encode(sha256.encode())}"
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
def test_a_file_in_any_parts_is_unchanged(service: Service, data: bytes, cuts: list[int], wrong: int):
    url = begin(service, len(data), sha256=hashlib.sha256(data).hexdigest())
    for end in [*sorted(cut for cut in cuts if cut < len(data)), len(data)]:
        offset = offset_of(service, url)
        refused = send(service, url, offset + wrong, b"x")
        assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
        response = send(service, url, offset, data[offset:end])
        assert response.status_code == 204
        assert int(response.headers["upload-offset"]) == end
    assert service.http.get(url).json()["complete"]
    answer = service.http.post("/maps", json={"map_id": "hall", "source": {"upload": url.split("/")[-1]}})
    assert answer.status_code == 202, answer.text
    request = service.catalog.builds.request(answer.json()["build_id"])
    assert service.catalog.store.get(request["source"]["key"]) == data
    assert request["file_name"] == "hall.xyz"
    assert service.http.delete(url).status_code == 204
    assert service.http.head(url).status_code == 404


def test_bytes_before_a_broken_connection_are_kept(service: Service):
    size = PART_BYTES + 5000
    url = begin(service, size)
    with connect(service) as connection:
        connection.sendall(patching(url, size) + bytes(PART_BYTES + 1000))
    wait_until(lambda: offset_of(service, url) == PART_BYTES + 1000)
    assert send(service, url, PART_BYTES + 1000, bytes(4000)).status_code == 204
    assert service.http.get(url).json()["complete"]


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


def test_a_part_with_a_wrong_checksum_is_not_kept(service: Service):
    url = begin(service)
    good = {"Upload-Checksum": f"sha256 {b64encode(hashlib.sha256(DATA[:100]).digest())}"}
    bad = {"Upload-Checksum": f"sha1 {b64encode(hashlib.sha1(b'other').digest())}"}
    refused = send(service, url, 0, DATA[:100], **bad)
    assert (refused.status_code, refused.json()["code"]) == (460, "checksum_mismatch")
    assert offset_of(service, url) == 0
    assert send(service, url, 0, DATA[:100], **good).status_code == 204
    for header in ("md5 AAAA", "sha256 AAAA", "sha256 ***", ""):
        assert send(service, url, 100, b"x", **{"Upload-Checksum": header}).status_code == 400
    assert offset_of(service, url) == 100


def test_a_file_with_a_wrong_checksum_is_removed(service: Service):
    url = begin(service, sha256="0" * 64)
    response = send(service, url, 0, DATA)
    assert (response.status_code, response.json()["code"]) == (460, "checksum_mismatch")
    assert service.http.head(url).status_code == 404


def test_bytes_over_the_announced_size_are_refused(service: Service):
    url = begin(service, 100)
    assert send(service, url, 0, bytes(101)).status_code == 413
    assert offset_of(service, url) == 0


def test_an_incomplete_upload_is_refused_as_a_source(service: Service):
    url = begin(service)
    send(service, url, 0, DATA[:10])
    for upload, status in ((url.split("/")[-1], 409), ("never-was", 404), ("../x", 400)):
        answer = service.http.post("/maps", json={"map_id": "hall", "source": {"upload": upload}})
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
        ({"Upload-Metadata": f"filename {b64encode(b'x')},filename {b64encode(b'x')}"}, 400),
        ({"Upload-Metadata": f"filename {b64encode(b'x')},sha256 {b64encode(b'short')}"}, 400),
        ({"Tus-Resumable": "2.0.0"}, 412),
    ],
)
def test_invalid_upload_announcements_are_refused(service: Service, headers: dict[str, str], status: int):
    good = {"Upload-Length": "10", "Upload-Metadata": f"filename {b64encode(b'x.ply')}"}
    before = service.catalog.store.folders("uploads")
    response = service.http.post("/uploads", headers={**good, **headers})
    assert response.status_code == status, response.text
    assert service.catalog.store.folders("uploads") == before


def test_a_part_needs_its_media_type_and_offset(service: Service):
    url = begin(service)
    assert service.http.patch(url, content=b"x", headers={"Upload-Offset": "0"}).status_code == 415
    assert service.http.patch(url, content=b"x", headers=PART).status_code == 400
    assert send(service, "/uploads/none", 0, b"x").status_code == 404


def test_options_describe_the_upload_protocol(service: Service):
    headers = service.http.options("/uploads").headers
    assert headers["tus-version"] == "1.0.0"
    assert set(headers["tus-extension"].split(",")) == {"creation", "checksum", "termination", "expiration"}
    assert headers["tus-max-size"] == str(service.settings.max_upload_bytes)


@serving(zenoh=False, body_timeout_s=0.3, max_upload_streams=1, maps={})
def test_a_stalled_body_frees_its_place(service: Service):
    url = begin(service)
    with connect(service) as connection:
        connection.sendall(patching(url, len(DATA)) + DATA[:700])
        assert b" 504 " in connection.recv(4096).split(b"\r\n")[0]
    assert offset_of(service, url) == 700

    def goes_on() -> bool:
        """Sends the rest. A busy machine may stall this body too, which is given up like the first."""
        offset = offset_of(service, url)
        return send(service, url, offset, DATA[offset:]).status_code == 204

    wait_until(goes_on)  # with a place that were not given back, it would never

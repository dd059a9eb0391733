"""Outages of the object store: a real S3 server behind toxiproxy is cut off, slow or broken."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.catalog.manifest import Manifest
from firstfix.store.store import Store
from tests.service.service_world import Service, running_service
from tests.toxiproxy import Link
from tests.waiting import let_pass, wait_until

pytestmark = pytest.mark.slow

SOON = {"deadline_ms": "10000"}  # these queries must not wait for the store
FAULTS: dict[str, Callable[[Link], None]] = {
    "cut": Link.cut,
    "hangs": lambda link: link.poison("timeout", timeout=0),
    "latency of 2 s": lambda link: link.poison("latency", latency=2000),
    "10 kB/s": lambda link: link.poison("bandwidth", rate=10),
    "resets": lambda link: link.poison("reset_peer", timeout=50),
    "half answers": lambda link: link.poison("limit_data", bytes=100),
}


def publish(catalog: Catalog, label: str, scratch: Path, blob_bytes: int = 300_000) -> str:
    """A version with a large file."""
    folder = scratch / label
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text(label)
    (folder / "blob.bin").write_bytes(os.urandom(blob_bytes))
    return catalog.publish("hall", folder, Manifest.for_directory(folder))


@pytest.mark.parametrize("fault", FAULTS)
def test_what_is_loaded_goes_on_and_what_is_new_comes_after(broken_s3, s3_url, tmp_path, fault):
    url, link = broken_s3
    direct = Catalog(Store.open(s3_url))  # other processes reach the store
    publish(direct, "1", tmp_path / "made")
    with running_service(tmp_path, store=url) as service:
        wait_until(lambda: service.http.get("/readyz").is_success)
        FAULTS[fault](link)
        second = publish(direct, "2", tmp_path / "made", 3_000_000)
        for _ in range(40):  # through several polls
            for transport in ("http", "zenoh"):
                assert service.ask(transport, options=SOON).x == 1
            let_pass(0.1)
        assert service.http.get("/readyz").is_success
        assert not (tmp_path / "cache" / second).exists(), "no half of it is seen"
        link.mend()
        wait_until(lambda: service.ask("http", options=SOON).x == 2)


def test_writing_into_a_store_that_is_gone_says_so(broken_s3: tuple[str, Link], tmp_path: Path):
    url, link = broken_s3
    with running_service(tmp_path, store=url, zenoh=False) as service:
        wait_until(lambda: service.http.get("/readyz").is_success)
        link.cut()
        assert_unavailable(service, "POST", "/maps")
        assert_unavailable(service, "GET", "/maps")
        assert_unavailable(service, "GET", "/builds/none")
        link.mend()
        form = {"files": {"source": ("map.pcd", b"points")}, "data": {"map_id": "hall"}}
        assert service.http.post("/maps", **form).status_code == 202


def assert_unavailable(service: Service, method: str, path: str) -> None:
    form = {"files": {"source": ("map.pcd", b"points")}, "data": {"map_id": "hall"}}
    response = service.http.request(method, path, **(form if method == "POST" else {}))
    assert (response.status_code, response.json()["code"]) == (503, "store_unavailable")
    assert int(response.headers["retry-after"]) >= 1

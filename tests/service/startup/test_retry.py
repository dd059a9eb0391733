"""Start on a store that does not answer, or that must not be written."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix.errors import InvalidOption, StoreUnavailable, StoreUnsafe
from firstfix.store.store import Store
from firstfix_service.startup import retry as start
from tests.service.service_world import running_service
from tests.waiting import wait_until


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(start, "FIRST_WAIT_S", 0.05)
    monkeypatch.setattr(start, "FIRST_TRY_S", 0.3)


@pytest.mark.slow
def test_a_store_that_is_cut_off_is_waited_for(broken_s3, tmp_path: Path):
    url, link = broken_s3
    link.cut()
    with running_service(tmp_path, store=url, zenoh=False) as service:
        assert service.http.get("/healthz").is_success
        assert "firstfix_http_requests" in service.http.get("/metrics").text
        for method, path in (("GET", "/readyz"), ("GET", "/maps"), ("POST", "/localize"), ("POST", "/maps")):
            response = service.http.request(method, path)
            assert (response.status_code, response.json()["code"]) == (503, "store_unavailable")
            assert "retry-after" in response.headers
        link.mend()
        wait_until(lambda: service.http.get("/readyz").is_success)
        assert service.http.get("/maps").json() == {"maps": [], "next": None}


@pytest.mark.slow
def test_a_store_that_hangs_does_not_keep_the_process_from_listening(broken_s3, tmp_path: Path):
    url, link = broken_s3
    link.poison("timeout", timeout=0)  # data is taken and never answered
    with running_service(tmp_path, store=url, zenoh=False) as service:
        assert service.http.get("/healthz").is_success
        assert service.http.get("/readyz").json()["detail"] == "the object store has not answered yet"
        link.mend()
        wait_until(lambda: service.http.get("/readyz").is_success)


def test_what_is_found_later_is_told_and_tried_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    errors = [StoreUnavailable("gone"), *[StoreUnsafe("it overwrites")] * 3]

    def probe(self: Store) -> None:
        if errors:
            raise errors.pop(0)

    monkeypatch.setattr(Store, "probe", probe)
    seen = set()
    with running_service(tmp_path, zenoh=False) as service:

        def is_ready() -> bool:
            response = service.http.get("/readyz")
            seen.add(response.json().get("code"))
            return response.is_success

        wait_until(is_ready)
    assert "store_unsafe" in seen


def test_what_waiting_does_not_mend_is_told_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    errors = [StoreUnavailable("gone"), InvalidOption("no such thing")]
    tries = []

    def probe(self: Store) -> None:
        tries.append(1)
        raise errors.pop(0)

    monkeypatch.setattr(Store, "probe", probe)
    with running_service(tmp_path, zenoh=False) as service:
        wait_until(lambda: service.http.get("/readyz").json()["code"] == "invalid_option")
    assert len(tries) == 2


def test_a_service_that_still_waits_can_be_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def probe(self: Store) -> None:
        raise StoreUnavailable("gone")

    monkeypatch.setattr(Store, "probe", probe)
    with running_service(tmp_path, zenoh=False) as service:
        assert service.http.get("/readyz").status_code == 503

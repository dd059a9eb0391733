"""Records of builds: requests are created once, statuses replaced, cancellations kept."""

from __future__ import annotations

import pytest

from firstfix.builds.records import BuildRecords, new_status
from firstfix.errors import Conflict, NotFound, StoreError
from firstfix.store.store import Store


def test_a_build_is_recorded_from_request_to_end(any_store: Store):
    records = BuildRecords(any_store)
    request = {"map_id": "hall", "source": {"key": "k"}, "file_name": "größe.ply", "config": {"a": 1}}
    records.put("b1", request)
    assert records.request("b1") == request
    assert records.status("b1") == new_status("queued", map_id="hall")
    running = new_status("running", map_id="hall", stage="read_map", progress=0.25)
    records.set_status("b1", running)
    assert records.status("b1") == running
    assert records.ids() == ["b1"]
    with pytest.raises(Conflict):
        records.put("b1", request)


def test_a_cancellation_is_kept_until_the_end(any_store: Store):
    records = BuildRecords(any_store)
    records.put("b1", {"map_id": "hall"})
    assert not records.is_cancel_requested("b1")
    records.request_cancel("b1")
    records.request_cancel("b1")
    assert records.is_cancel_requested("b1")
    records.set_status("b1", new_status("cancelled", map_id="hall"))
    with pytest.raises(Conflict):
        records.request_cancel("b1")


def test_a_missing_build_is_not_found(any_store: Store):
    records = BuildRecords(any_store)
    for call in (records.request, records.status, records.request_cancel):
        with pytest.raises(NotFound, match="no build b1"):
            call("b1")


def test_a_damaged_record_is_refused():
    records = BuildRecords(Store.open("memory://"))
    records.put("b1", {})
    for data in (b"{", b"[]", b"\xff\xfe"):
        records.store.put("builds/b1/status.json", data)
        with pytest.raises(StoreError):
            records.status("b1")


def test_an_invalid_status_is_refused():
    with pytest.raises(ValueError, match="state"):
        new_status("done", map_id="hall")
    assert new_status("running", map_id="hall", progress=1.5)["progress"] == 1.0


def test_an_error_is_recorded_without_secrets():
    why = {"code": "build_failed", "detail": "cannot read https://user:hunter2@host/a?X-Amz-Signature=abc123"}
    error = new_status("failed", map_id="hall", error=why)["error"]
    assert error == {"code": "build_failed", "detail": "cannot read https://***@host/a?X-Amz-Signature=***"}

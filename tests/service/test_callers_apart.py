"""Callers of one service: none reads, stops or delays another."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest

from firstfix.access.permissions import Grant, Scope
from firstfix.builds.callers import CallerUsage
from firstfix_service.auth.principal import Principal
from firstfix_service.http_api.parts import UploadParts
from tests.service.callers_world import CLOUD, callers
from tests.waiting import wait_until


def refusal(answer: httpx.Response) -> tuple[int, str]:
    return answer.status_code, answer.json()["code"]


def build(url: str) -> dict[str, object]:
    return {"map_id": "hall", "source": {"upload": url.split("/")[-1]}}


def test_an_upload_is_hidden_from_other_callers(tmp_path: Path):
    with callers(tmp_path) as these:
        url = these.a.begin(len(CLOUD))
        nowhere = "/uploads/u-that-never-was"
        for there, other in ((url, these.b), (nowhere, these.a)):
            assert other.call("HEAD", there).status_code == 404
            answers = [
                other.call("GET", there),
                other.send(there, CLOUD),
                other.call("DELETE", there),
                other.call("POST", "/maps", json=build(there)),
            ]
            for answer in answers:
                assert refusal(answer) == (404, "not_found")
                detail = answer.json()["detail"]
                assert detail.replace(there.split("/")[-1], "ID") == "no upload ID", "the same as not there"
        assert these.a.send(url, CLOUD).status_code == 204
        assert these.a.call("POST", "/maps", json=build(url)).status_code == 202
        assert these.admin.call("HEAD", url).headers["upload-offset"] == str(len(CLOUD))
        assert these.admin.call("DELETE", url).status_code == 204


def test_open_uploads_of_one_caller_are_limited(tmp_path: Path):
    with callers(tmp_path, max_open_uploads=4, max_open_uploads_per_caller=2) as these:
        urls = [these.a.begin() for _ in range(2)]
        refused = these.a.announce()
        assert refusal(refused) == (429, "quota_exceeded")
        assert "retry-after" not in refused.headers, "waiting does not help"
        these.b.begin()
        assert these.a.call("DELETE", urls[0]).status_code == 204
        these.a.begin()
        these.b.begin()
        assert refusal(these.admin.announce()) == (503, "overloaded")


def test_bytes_of_one_callers_uploads_are_limited(tmp_path: Path):
    with callers(tmp_path, max_upload_bytes=1000, largest_files_per_caller=1) as these:
        url = these.a.begin(600)
        assert refusal(these.a.announce(401)) == (429, "quota_exceeded")
        these.a.begin(400)
        these.b.begin(1000)
        these.a.call("DELETE", url)
        these.a.begin(600)


def test_streams_of_one_caller_are_limited(tmp_path: Path):
    with (
        callers(tmp_path, max_upload_streams=4, max_upload_streams_per_caller=2) as these,
        ExitStack() as open_,
    ):
        places = these.service.app.state.start.parts[UploadParts].streams
        for _ in range(2):
            open_.enter_context(these.a.sending(these.a.begin(), 1000))
        wait_until(lambda: places.taken == 2)
        for refused in (these.a.send(these.a.begin(3), b"abc"), these.a.post_map()):
            assert refusal(refused) == (429, "quota_exceeded")
            assert int(refused.headers["retry-after"]) >= 1
        assert these.b.send(these.b.begin(3), b"abc").status_code == 204
        assert these.b.post_map().status_code == 202
        open_.close()
        wait_until(lambda: places.taken == 0)
        assert these.a.send(these.a.begin(3), b"abc").status_code == 204


def test_event_streams_of_one_caller_are_limited(tmp_path: Path):
    with callers(tmp_path, max_event_streams=4, max_event_streams_per_caller=1) as these:
        events = f"{these.a.post_map().headers['location']}/events"

        with (
            httpx.Client(base_url=these.service.url, timeout=30) as http,
            http.stream("GET", events, headers=these.a.headers) as first,
            http.stream("GET", events, headers=these.b.headers) as other,
        ):
            assert (first.status_code, other.status_code) == (200, 200)
            assert refusal(these.a.call("GET", events)) == (429, "quota_exceeded")


def test_an_idempotency_key_counts_for_one_caller(tmp_path: Path):
    with callers(tmp_path) as these:
        mine, theirs = these.a.post_map(key="night-1"), these.b.post_map(key="night-1")
        assert (mine.status_code, theirs.status_code) == (202, 202)
        assert mine.headers["location"] != theirs.headers["location"]
        assert these.a.post_map(key="night-1").headers["location"] == mine.headers["location"]
        assert refusal(these.a.post_map("attic", key="night-1")) == (409, "idempotency_conflict")


def test_builds_of_one_caller_are_limited(tmp_path: Path):
    with callers(tmp_path, build_minutes_per_day=1440, max_builds_per_caller=2) as these:
        first, _ = these.a.post_map(key="night-1"), these.a.post_map()
        refused = these.a.post_map()
        assert refusal(refused) == (429, "quota_exceeded")
        assert int(refused.headers["retry-after"]) >= 1
        assert refusal(these.a.post_map(key="night-2")) == (429, "quota_exceeded")
        assert these.a.post_map(key="night-1").headers["location"] == first.headers["location"]
        assert these.b.post_map().status_code == 202
        assert these.a.call("DELETE", first.headers["location"]).json()["state"] == "cancelled"
        assert these.a.post_map().status_code == 202


def test_a_refused_idempotency_key_does_not_evade_the_limit(tmp_path: Path):
    """Claims the key while the upload is incomplete: the build begins only later."""
    with callers(tmp_path, build_minutes_per_day=1440, max_builds_per_caller=1) as these:
        url = these.a.begin(len(CLOUD))

        def post(key: str) -> httpx.Response:
            return these.a.call("POST", "/maps", json=build(url), headers={"Idempotency-Key": key})

        assert [refusal(post(key)) for key in "xyz"] == [(409, "conflict")] * 3
        these.a.send(url, CLOUD)
        assert post("x").status_code == 202
        assert refusal(post("y")) == (429, "quota_exceeded")
        assert post("x").status_code == 202


def test_minutes_of_one_callers_builds_are_limited(tmp_path: Path):
    with callers(tmp_path, build_minutes_per_day=10) as these:
        first = these.a.post_map().json()["build_id"]
        owner = these.service.catalog.builds.request(first)["owner"]
        usage = CallerUsage(these.service.catalog.builds)
        usage.charge(owner, first, 1, 9 * 60)
        assert these.a.post_map().status_code == 202
        usage.charge(owner, first, 2, 60)
        refused = these.a.post_map()
        assert refusal(refused) == (429, "quota_exceeded")
        assert 1 <= int(refused.headers["retry-after"]) <= 86400
        assert these.b.post_map().status_code == 202


@pytest.mark.parametrize(
    ("method", "path"), [("GET", ""), ("GET", "/events"), ("DELETE", "")], ids=["status", "events", "cancel"]
)
def test_builds_are_shared_by_callers_of_their_map(tmp_path: Path, method: str, path: str):
    """Callers who share a map share its builds."""
    with callers(tmp_path) as these:
        location = these.a.post_map().headers["location"]
        these.a.call("DELETE", location)
        assert these.b.call(method, f"{location}{path}").status_code in (200, 409)


def test_a_principal_owns_records_with_its_name():
    build_scope = Grant(frozenset({Scope.BUILD}))
    mine, admin = Principal("key:a", build_scope), Principal("key:b", Grant(frozenset({Scope.ADMIN})))
    assert [mine.owns(owner) for owner in ("key:a", "key:b", None, "")] == [True, False, True, False]
    assert admin.owns("key:a")
    assert Principal("address:192.0.2.1").repeats_as == Principal("address:192.0.2.2").repeats_as
    assert Principal("key:a").repeats_as != Principal("key:b").repeats_as

"""POST /maps with an Idempotency-Key: repeated requests make one build."""

from __future__ import annotations

import json
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

from firstfix.builds.callers import CallersKey, claim_build
from firstfix_service.auth.principal import ANONYMOUS
from firstfix_service.http_api.bodies.submission import NamedUrl, Submission
from tests.service.service_world import Service, running_service

BODY = {"map_id": "hall", "source": {"url": "s3://maps/hall.laz"}, "config": {"level": False}}


@pytest.fixture
def recorder(tmp_path: Path) -> Iterator[Service]:
    with running_service(tmp_path, zenoh=False, source_urls=("s3://maps/",)) as service:
        yield service


def post(service: Service, key: str | None, **changes: object) -> httpx.Response:
    headers = {} if key is None else {"Idempotency-Key": key}
    return service.http.post("/maps", json={**BODY, **changes}, headers=headers)


def test_the_same_request_is_one_build(recorder: Service):
    first, again = post(recorder, "night-1"), post(recorder, "night-1")
    assert (first.status_code, again.status_code) == (202, 202)
    assert first.headers["location"] == again.headers["location"]
    assert post(recorder, "night-2").headers["location"] != first.headers["location"]
    assert post(recorder, None).headers["location"] != post(recorder, None).headers["location"]
    assert len(recorder.catalog.builds.ids()) == 4


def test_another_request_with_the_key_is_a_conflict(recorder: Service):
    post(recorder, "night-1")
    other = post(recorder, "night-1", map_id="attic")
    assert (other.status_code, other.json()["code"]) == (409, "idempotency_conflict")
    assert len(recorder.catalog.builds.ids()) == 1


def test_forms_are_compared_by_their_content(recorder: Service):
    def form(data: bytes) -> httpx.Response:
        return recorder.http.post(
            "/maps",
            data={"map_id": "hall"},
            files={"source": ("a.xyz", data)},
            headers={"Idempotency-Key": "f"},
        )

    assert form(b"0 0 0\n").headers["location"] == form(b"0 0 0\n").headers["location"]
    assert form(b"1 0 0\n").json()["code"] == "idempotency_conflict"


def test_it_holds_over_replicas(tmp_path: Path):
    changes = {"zenoh": False, "source_urls": ("s3://maps/",), "store": str(tmp_path / "store")}
    with (
        running_service(tmp_path / "a", **changes) as first,
        running_service(tmp_path / "b", **changes) as second,
        ThreadPoolExecutor(8) as threads,
    ):
        replicas = [first, second] * 8
        answers = list(threads.map(lambda replica: post(replica, "k"), replicas))
        assert {answer.status_code for answer in answers} == {202}
        assert len({answer.headers["location"] for answer in answers}) == 1
        assert len(first.catalog.builds.ids()) == 1


def test_a_service_killed_between_claim_and_record_is_made_good(recorder: Service):
    submission = Submission(ANONYMOUS, "hall", NamedUrl("s3://maps/hall.laz"), None, {"level": False})
    key = CallersKey(ANONYMOUS.name, "night-1")
    claim_build(recorder.catalog.store, key, submission.fingerprint(), "b-of-the-dead")
    answer = post(recorder, "night-1")
    assert answer.json()["build_id"] == "b-of-the-dead"
    assert recorder.catalog.builds.ids() == ["b-of-the-dead"]


def test_what_was_refused_leaves_the_key_free(recorder: Service):
    assert post(recorder, "night-1", config={"speed": 1}).status_code == 400
    assert post(recorder, "night-1").status_code == 202


@pytest.mark.parametrize("key", ["", "a b", "x" * 256])
def test_a_key_is_short_and_printable(recorder: Service, key: str):
    assert post(recorder, key).status_code == 400
    assert recorder.catalog.builds.ids() == []


@pytest.mark.parametrize(
    ("config", "path"),
    [
        ({"speed": 1}, "speed"),
        ({"viewpoints": {"spacing_m": 0}}, "viewpoints.spacing_m"),
        ({"engine": {"search": {"engine": "psychic"}}}, "engine.search.engine"),
        ({"sensor": "vlp-17"}, "sensor"),
    ],
)
def test_a_config_is_checked_before_anything_is_kept(recorder: Service, config: dict, path: str):
    for answer in (
        post(recorder, None, config=config),
        recorder.http.post(
            "/maps",
            data={"map_id": "hall", "config": json.dumps(config)},
            files={"source": ("a.xyz", b"0 0 0\n")},
        ),
    ):
        assert (answer.status_code, answer.json()["code"]) == (400, "invalid_option")
        assert f"{path}: " in answer.json()["detail"]
    assert recorder.catalog.store.list("maps") == recorder.catalog.store.list("builds") == []


def test_numbers_that_json_does_not_have_are_refused(recorder: Service):
    for number in ("NaN", "Infinity", "1e999"):
        body = f'{{"map_id": "hall", "source": {{"url": "s3://maps/x"}}, "config": {{"level": {number}}}}}'
        answer = recorder.http.post("/maps", content=body, headers={"Content-Type": "application/json"})
        assert answer.json()["code"] == "malformed_data", number

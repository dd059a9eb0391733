"""Recorded queries over HTTP: listed, shown, fetched, told the truth of, and hidden from others."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from firstfix.catalog.recorded_queries import RecordedQueries, RecordedQuery
from tests.service.access_world import bearer, known
from tests.service.service_world import SCAN_BODY, XYZ, Service

POSE = {"position": [1.0, 2.0, 3.0], "quaternion": [0.0, 0.0, 0.0, 1.0]}


def record(service: Service, number: int, asked: str = "hall", **answer: Any) -> str:
    query_id = f"20260101t{number:012d}-0000000a"
    record = {"verdict": "rejected", "reasons": ["low_probability"], "probability": 0.2, **answer}
    recorded = RecordedQuery(
        query_id, "2026-01-01T00:00:00+00:00", "http", "r", "", asked, XYZ, "", {}, record, 1200
    )
    RecordedQueries(service.catalog.store).put(recorded, SCAN_BODY)
    return query_id


def told(answer: Any) -> dict[str, Any]:
    """The truth in an answer, without who has told it and when."""
    truth = answer.json()["truth"]
    return {name: truth[name] for name in ("map_id", "T_map_sensor")}


def found(service: Service, **params: Any) -> list[str]:
    return [one["query_id"] for one in service.http.get("/recorded-queries", params=params).json()["queries"]]


def test_recorded_queries_are_listed_newest_first_and_filtered(service: Service):
    one, two = record(service, 1), record(service, 2, verdict="ambiguous", reasons=["several_places"])
    three = record(service, 3, "attic")
    anywhere = record(service, 4, "", map_id="hall")
    assert found(service) == [anywhere, three, two, one]
    assert found(service, map_id="hall") == [anywhere, two, one]
    assert found(service, verdict="ambiguous") == [two]
    assert found(service, reason="low_probability", map_id="hall") == [anywhere, one]
    assert service.http.get("/recorded-queries", params={"verdict": "so-so"}).status_code == 400


def test_every_recorded_query_is_on_one_page(service: Service):
    made = [record(service, number) for number in range(7)]
    seen, after = [], None
    while True:
        params = {"limit": 3} if after is None else {"limit": 3, "after": after}
        page = service.http.get("/recorded-queries", params=params).json()
        seen += [one["query_id"] for one in page["queries"]]
        after = page["next"]
        if after is None:
            break
    assert seen == made[::-1]


def test_a_damaged_record_is_left_out_of_the_list(service: Service):
    one, two = record(service, 1), record(service, 2)
    service.catalog.store.put(f"recorded-queries/{one}.json", b"{")
    assert found(service) == [two]


def test_the_body_of_a_recorded_query_can_be_sent_again(service: Service):
    query_id = record(service, 1)
    body = service.http.get(f"/recorded-queries/{query_id}/body")
    assert body.content == SCAN_BODY
    assert service.http.get(f"/recorded-queries/{query_id}").json()["media_type"] == XYZ
    again = service.http.post("/localize?map=hall", content=body.content, headers={"Content-Type": XYZ})
    assert again.is_success


def test_the_truth_is_stored_with_the_query(service: Service):
    query_id = record(service, 1)
    assert service.http.get(f"/recorded-queries/{query_id}").json()["truth"] is None
    truth = {"map_id": "hall", "T_map_sensor": POSE}
    put = service.http.put(f"/recorded-queries/{query_id}/truth", json=truth)
    assert told(put) == told(service.http.get(f"/recorded-queries/{query_id}")) == truth
    assert put.json()["truth"]["told_by"] == "", "an address is nobody in particular"
    assert put.json()["truth"]["told_at"] > "2026"
    outside = {"map_id": "hall", "T_map_sensor": None}
    assert told(service.http.put(f"/recorded-queries/{query_id}/truth", json=outside)) == outside
    assert service.http.delete(f"/recorded-queries/{query_id}/truth").json()["truth"] is None
    assert service.http.get(f"/recorded-queries/{query_id}/body").content == SCAN_BODY


@pytest.mark.parametrize(
    "truth",
    [
        {},
        {"map_id": "hall"},
        {"map_id": "no such name!", "T_map_sensor": None},
        {"map_id": "hall", "T_map_sensor": {**POSE, "quaternion": [0, 0, 0, 0]}},
        {"map_id": "hall", "T_map_sensor": {**POSE, "position": [0, 0]}},
        {"map_id": "hall", "T_map_sensor": {**POSE, "position": [0, -1e40, 0]}},
        {"map_id": "hall", "T_map_sensor": POSE, "more": 1},
    ],
)
def test_an_invalid_truth_is_refused(service: Service, truth: dict[str, Any]):
    query_id = record(service, 1)
    assert service.http.put(f"/recorded-queries/{query_id}/truth", json=truth).status_code == 400
    assert service.http.get(f"/recorded-queries/{query_id}").json()["truth"] is None


def test_a_removed_query_is_not_found(service: Service):
    query_id = record(service, 1)
    assert service.http.delete(f"/recorded-queries/{query_id}").status_code == 204
    assert found(service) == []
    for path in ("", "/body"):
        assert service.http.get(f"/recorded-queries/{query_id}{path}").status_code == 404
    assert service.http.delete(f"/recorded-queries/{query_id}").status_code == 404
    assert service.http.get("/recorded-queries/..%2f..%2fkeys").status_code in (400, 404)


def test_queries_about_forbidden_maps_are_hidden(closed: Service):
    mine, both, anywhere = record(closed, 1), record(closed, 2, "hall,attic"), record(closed, 3, "")
    headers = bearer(known(closed, "build", maps=("hall",)))
    listed = closed.http.get("/recorded-queries", headers=headers).json()["queries"]
    assert [one["query_id"] for one in listed] == [mine]
    for hidden in (both, anywhere):
        for path in ("", "/body"):
            assert closed.http.get(f"/recorded-queries/{hidden}{path}", headers=headers).status_code == 404
        truth = {"map_id": "hall", "T_map_sensor": None}
        assert (
            closed.http.put(f"/recorded-queries/{hidden}/truth", json=truth, headers=headers).status_code
            == 404
        )
        assert (
            closed.http.put(f"/recorded-queries/{mine}/truth", json=truth, headers=headers)
            .json()["truth"]["told_by"]
            .startswith("key:")
        )
    elsewhere = {"map_id": "attic", "T_map_sensor": None}
    assert (
        closed.http.put(f"/recorded-queries/{mine}/truth", json=elsewhere, headers=headers).status_code == 403
    )
    assert (
        closed.http.get("/recorded-queries", params={"map_id": "attic"}, headers=headers).status_code == 403
    )
    assert closed.http.delete(f"/recorded-queries/{mine}", headers=headers).status_code == 403
    robot = known(closed, "localize")
    assert closed.http.get("/recorded-queries", headers=bearer(robot)).status_code == 403


def test_a_caller_sees_the_rights_of_its_key(closed: Service):
    headers = bearer(known(closed, "build", maps=("hall*",)))
    caller = closed.http.get("/caller", headers=headers).json()
    assert (caller["scopes"], caller["maps"], caller["authentication"]) == (
        ["localize", "build"],
        ["hall*"],
        True,
    )
    assert caller["name"].startswith("key:")
    assert closed.http.get("/caller").status_code == 401


def test_a_media_type_with_line_breaks_adds_no_header(service: Service):
    query_id = record(service, 1)
    stored = RecordedQueries(service.catalog.store)
    hostile = replace(stored.get(query_id), media_type="text/html\r\nX-Injected: 1; \u2603<b>")
    stored.put(hostile, SCAN_BODY)
    answer = service.http.get(f"/recorded-queries/{query_id}/body")
    assert answer.status_code == 200
    assert answer.content == SCAN_BODY
    assert "x-injected" not in answer.headers
    assert answer.headers["x-body-type"] == "text/htmlX-Injected: 1; <b>"
    assert answer.headers["content-type"] == "application/octet-stream"
    assert answer.headers["x-content-type-options"] == "nosniff"

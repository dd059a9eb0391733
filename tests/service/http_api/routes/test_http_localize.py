"""Localize over HTTP: the body's limit, the options, and geographic poses of maps with a georeference."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.catalog.geopose import Georeference
from firstfix.transform import from_quaternion, make_transform
from tests.service.service_world import SCAN_BODY, XYZ, Service, publish, running_service, serving
from tests.waiting import wait_until

HEADERS = {"Content-Type": XYZ}


def test_server_timing_names_the_stages(service: Service):
    response = service.http.post("/localize?map=hall", content=SCAN_BODY, headers=HEADERS)
    stages = [entry.split(";")[0] for entry in response.headers["server-timing"].split(", ")]
    assert stages == list(response.json()["timings_ms"])


@serving(max_body_bytes=100_000, zenoh=False)
def test_a_streamed_body_is_stopped_at_the_limit(service):
    sent = 0

    def endless() -> Iterator[bytes]:
        nonlocal sent
        while sent < 64 << 20:
            sent += 1 << 16
            yield bytes(1 << 16)

    response = service.http.post("/localize?map=hall", content=endless(), headers=HEADERS)
    assert (response.status_code, response.json()["code"]) == (413, "too_large")
    assert sent < 64 << 20, "the rest was not taken"
    wait_until(lambda: service.value("firstfix_body_bytes") == 0)


def test_doubled_options_and_bad_map_ids_are_refused(service: Service):
    for query in ("?map=hall&map=hall", "?map=hall&version=a&version=b", "?map=hall,", "?map=hall,a/b"):
        response = service.http.post(f"/localize{query}", content=SCAN_BODY, headers=HEADERS)
        assert (response.status_code, response.json()["code"]) == (400, "invalid_option"), query


def test_a_query_to_the_only_map_may_omit_its_name(service: Service):
    wait_until(lambda: service.http.post("/localize", content=SCAN_BODY, headers=HEADERS).is_success)
    answer = service.http.post("/localize", content=SCAN_BODY, headers=HEADERS).json()
    assert answer["map_id"] == "hall"


GEOPOSE = "application/geopose+json"
PLACE = {"latitude_deg": 48.2649, "longitude_deg": 11.6713, "height_m": 529.4, "x_axis_deg": 30.0}
KNOWN = Georeference.with_heading(48.2649, 11.6713, 529.4, 30.0)


def ask(service: Service, accept: str | None, query: str = "map=hall"):
    headers = {"Content-Type": XYZ} | ({} if accept is None else {"Accept": accept})
    return service.http.post(f"/localize?{query}", content=SCAN_BODY, headers=headers)


def test_a_map_with_a_place_gives_geographic_poses(service: Service):
    refused = ask(service, GEOPOSE)
    assert (refused.status_code, refused.json()["code"]) == (406, "not_acceptable")
    put = service.http.put("/maps/hall/georeference", json=PLACE)
    assert put.status_code == 200, put.text
    assert put.json()["x_axis_deg"] == pytest.approx(30)
    assert service.http.get("/maps/hall/georeference").json() == put.json()
    answer = ask(service, GEOPOSE)
    assert answer.headers["content-type"] == GEOPOSE
    expected = KNOWN.geopose(make_transform(np.eye(3), [1, 100, 0]))  # as the fake localizer answers
    assert _near(answer.json(), expected)
    assert "server-timing" in answer.headers
    both = ask(service, GEOPOSE, "")
    assert both.headers["content-type"] == GEOPOSE, "the map that answered has one"
    assert service.http.delete("/maps/hall/georeference").status_code == 204
    assert service.http.delete("/maps/hall/georeference").status_code == 404
    assert service.http.get("/maps/hall/georeference").status_code == 404
    assert ask(service, GEOPOSE).status_code == 406
    assert ask(service, GEOPOSE, "").status_code == 406


def _near(found: dict, expected: dict) -> bool:
    pairs = ((found[part], expected[part]) for part in ("position", "quaternion"))
    return all(a[name] == pytest.approx(b[name], abs=1e-12) for a, b in pairs for name in b)


@serving(zenoh=False)
def test_the_robots_pose_is_given_where_its_mounting_is_known(service):
    T = from_quaternion((5, 6, 7), (0, 0, 1, 1))
    service.behaviour.answers = lambda localizer, scan, *_: replace(localizer.found(scan), T_map_base=T)
    service.http.put("/maps/hall/georeference", json=PLACE)
    assert _near(ask(service, GEOPOSE).json(), KNOWN.geopose(T))


@serving(zenoh=False)
def test_an_answer_without_a_pose_is_plain_json(service):
    service.behaviour.answers = lambda *_: Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))
    service.http.put("/maps/hall/georeference", json=PLACE)
    answer = ask(service, GEOPOSE)
    assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")
    assert answer.json()["reasons"] == ["low_inlier_ratio"]


def test_the_form_of_the_answer_is_negotiated(service):
    """By ``AnswerForm``, whose own test has more cases."""
    service.http.put("/maps/hall/georeference", json=PLACE)
    for accept, status, media_type in (
        (None, 200, "application/json"),
        ("text/html", 406, "application/problem+json"),
        (f"{GEOPOSE}, application/json;q=0.5", 200, GEOPOSE),
        (f"{GEOPOSE};q=0, */*", 200, "application/json"),
    ):
        answer = ask(service, accept)
        assert (answer.status_code, answer.headers["content-type"]) == (status, media_type), accept


@pytest.mark.parametrize(
    "body",
    [
        {**PLACE, "quaternion": [0, 0, 0, 1]},
        {key: value for key, value in PLACE.items() if key != "x_axis_deg"},
        {**PLACE, "latitude_deg": 91},
        {**PLACE, "height_m": "high"},
        {**PLACE, "anchor_m": [1, 2]},
        {**PLACE, "altitude": 3},
        {**PLACE, "x_axis_deg": None, "quaternion": [0, 0, 0, 3]},
    ],
)
def test_invalid_places_are_refused(service: Service, body: dict):
    answer = service.http.put("/maps/hall/georeference", json=body)
    assert (answer.status_code, answer.json()["code"]) == (400, "invalid_option")
    assert service.catalog.store.list("maps/hall/georeference") == []


def test_an_unknown_map_has_no_place(service: Service):
    assert service.http.put("/maps/attic/georeference", json=PLACE).status_code == 404
    answer = service.http.put(
        "/maps/hall/georeference", content=b"{", headers={"Content-Type": "application/json"}
    )
    assert answer.json()["code"] == "malformed_data"


def test_another_replica_uses_a_new_place_even_without_the_store(tmp_path: Path):
    store = tmp_path / "store"
    with (
        running_service(tmp_path / "a", zenoh=False, store=str(store)) as first,
        running_service(tmp_path / "b", zenoh=False, store=str(store), georeference_ttl_s=0) as second,
    ):
        publish(first.catalog, "hall", "1", tmp_path / "made")
        first.http.put("/maps/hall/georeference", json=PLACE)
        turned = {**PLACE, "x_axis_deg": None, "quaternion": list(KNOWN.quaternion)}
        assert ask(second, GEOPOSE).json() == ask(first, GEOPOSE).json()
        first.http.put("/maps/hall/georeference", json={**turned, "latitude_deg": 10})
        assert ask(second, GEOPOSE).json()["position"]["lat"] == pytest.approx(10, abs=0.01)
        record = json.loads((store / "maps/hall/georeference/000002.json").read_text())
        assert record["latitude_deg"] == 10


def test_the_media_type_names_the_columns_of_rows(service: Service):
    points = np.frombuffer(SCAN_BODY, "<f4").reshape(-1, 3)
    rows = np.column_stack([points, np.zeros((len(points), 2))]).astype("<f4").tobytes()
    for columns, status, code in (
        ('"x,y,z,intensity,ring"', 200, None),
        ("x,y,z,_,_", 200, None),
        ("x,y,intensity", 400, "invalid_option"),
        ("x,y,z,intensity,ring,time,_", 400, "malformed_data"),
    ):
        headers = {"Content-Type": f"application/vnd.firstfix.xyzi; columns={columns}"}
        response = service.http.post("/localize?map=hall", content=rows, headers=headers)
        assert (response.status_code, response.json().get("code")) == (status, code), columns

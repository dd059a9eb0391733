from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Reason, Verdict
from firstfix.catalog.geopose import Georeference
from firstfix.transform import from_quaternion, make_transform
from tests.service.service_world import SCAN_BODY, XYZ, Behaviour, Service, publish, running_service

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


def test_the_robots_pose_where_its_mount_is_known(tmp_path: Path):
    class Mounted(Behaviour):
        def load(self, directory: Path):
            localizer = super().load(directory)
            plain = localizer.localize

            def localize(scan, *_: object):
                answer = plain(scan)
                T = from_quaternion((5, 6, 7), (0, 0, 1, 1))
                return Localization(
                    answer.verdict, (), answer.T_map_sensor, T, answer.covariance, 0.9, timings_ms={}
                )

            localizer.localize = localize
            return localizer

    with running_service(tmp_path, zenoh=False, behaviour=Mounted()) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        service.http.put("/maps/hall/georeference", json=PLACE)
        found = ask(service, GEOPOSE).json()
        assert _near(found, KNOWN.geopose(from_quaternion((5, 6, 7), (0, 0, 1, 1))))


def test_not_localized_is_told_in_plain_json(tmp_path: Path):
    class Lost(Behaviour):
        def load(self, directory: Path):
            localizer = super().load(directory)
            localizer.localize = lambda *_: Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,))
            return localizer

    with running_service(tmp_path, zenoh=False, behaviour=Lost()) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        service.http.put("/maps/hall/georeference", json=PLACE)
        answer = ask(service, GEOPOSE)
        assert (answer.status_code, answer.headers["content-type"]) == (200, "application/json")
        assert answer.json()["reasons"] == ["low_inlier_ratio"]


@pytest.mark.parametrize(
    ("accept", "status", "media_type"),
    [
        (None, 200, "application/json"),
        ("*/*", 200, "application/json"),
        ("application/*", 200, "application/json"),
        ("text/html", 406, "application/problem+json"),
        ("text/html, */*;q=0.1", 200, "application/json"),
        (f"{GEOPOSE}, application/json;q=0.5", 200, GEOPOSE),
        (f"{GEOPOSE};q=0.5, application/json", 200, "application/json"),
        (f"{GEOPOSE};q=0, */*", 200, "application/json"),
        (f"application/json;q=0, {GEOPOSE}", 200, GEOPOSE),
        ("application/json;q=x", 406, "application/problem+json"),
    ],
)
def test_the_form_is_negotiated(service: Service, accept: str | None, status: int, media_type: str):
    service.http.put("/maps/hall/georeference", json=PLACE)
    answer = ask(service, accept)
    assert (answer.status_code, answer.headers["content-type"]) == (status, media_type)


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
def test_what_is_no_place_is_refused(service: Service, body: dict):
    answer = service.http.put("/maps/hall/georeference", json=body)
    assert (answer.status_code, answer.json()["code"]) == (400, "invalid_option")
    assert service.catalog.store.list("maps/hall/georeference") == []


def test_a_map_that_is_not_there_lies_nowhere(service: Service):
    assert service.http.put("/maps/attic/georeference", json=PLACE).status_code == 404
    answer = service.http.put(
        "/maps/hall/georeference", content=b"{", headers={"Content-Type": "application/json"}
    )
    assert answer.json()["code"] == "malformed_data"


def test_another_replica_follows_and_outlives_the_store(tmp_path: Path):
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

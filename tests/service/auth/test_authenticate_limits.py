"""Rate limits of callers."""

from __future__ import annotations

from pathlib import Path

import httpx

from tests.service.access_world import ask_zenoh, get, give, localize
from tests.service.service_world import publish, running_service
from tests.waiting import wait_until


def test_queries_of_one_caller_are_limited_alone(tmp_path: Path):
    with running_service(tmp_path, auth="on", keys_refresh_s=0.1, localize_per_s=0.01) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        one, other = give(service, "localize"), give(service, "localize")
        wait_until(lambda: get(service, "/maps", one).is_success and get(service, "/maps", other).is_success)
        assert localize(service, one).is_success
        refused = localize(service, one)
        assert (refused.status_code, refused.json()["code"]) == (429, "rate_limited")
        assert 1 <= int(refused.headers["retry-after"]) <= 100
        assert ask_zenoh(service, one).json["code"] == "rate_limited", "whichever way the caller comes"
        assert get(service, "/maps", one).is_success, "only queries are counted"
        assert ask_zenoh(service, other).ok


def test_builds_and_callers_without_authentication_are_limited(tmp_path: Path):
    limits = {"build_minutes_per_day": 1, "builds_per_hour": 1, "localize_per_s": 0.01}
    with running_service(tmp_path, **limits, zenoh=False) as service:
        upload = {"data": {"map_id": "hall"}, "files": {"source": ("a.xyz", b"0 0 0\n")}}
        assert service.http.post("/maps", **upload).status_code == 202
        assert service.http.post("/maps", **upload).status_code == 429
        assert localize(service, None).status_code == 404
        assert localize(service, None).status_code == 429


def test_bad_credentials_are_limited_by_address_and_good_ones_are_not(tmp_path: Path):
    with running_service(
        tmp_path,
        auth="on",
        keys_refresh_s=0.1,
        auth_failures_per_min=2,
        trusted_proxies=("127.0.0.0/8",),
        zenoh=False,
    ) as service:

        def status(key: str, address: str) -> int:
            headers = {"Authorization": f"Bearer {key}", "X-Forwarded-For": address}
            return service.http.get("/maps", headers=headers).status_code

        assert [status("wrong", "192.0.2.1") for _ in range(4)] == [401, 401, 429, 429]
        assert status("wrong", "192.0.2.2") == 401, "another address"
        good = give(service, "localize")
        wait_until(lambda: status(good, "192.0.2.3") == 200)
        assert status(good, "192.0.2.1") == 200, "robots share addresses"


def test_forwarded_addresses_of_strangers_are_not_believed(tmp_path: Path):
    with running_service(tmp_path, auth="on", auth_failures_per_min=1, zenoh=False) as service:
        bad = {"Authorization": "Bearer wrong"}
        statuses = [
            service.http.get("/maps", headers={**bad, "X-Forwarded-For": f"192.0.2.{n}"}).status_code
            for n in range(3)
        ]
        assert statuses == [401, 429, 429]


def test_changes_of_a_map_are_limited_by_caller(tmp_path: Path):
    exposed = {"auth": "on", "host": "0.0.0.0", "changes_per_min": 2}
    with running_service(tmp_path, **exposed, keys_refresh_s=0.1, zenoh=False) as service:
        for map_id in ("hall", "yard"):
            publish(service.catalog, map_id, "1", service.scratch)
            publish(service.catalog, map_id, "2", service.scratch)
        one, other = give(service, "build"), give(service, "build")
        wait_until(lambda: get(service, "/maps", one).is_success and get(service, "/maps", other).is_success)

        def roll_back(key: str, map_id: str) -> httpx.Response:
            return service.http.post(f"/maps/{map_id}/rollback", headers={"Authorization": f"Bearer {key}"})

        statuses = [roll_back(one, "hall").status_code for _ in range(3)]
        assert statuses == [200, 200, 429]
        refused = roll_back(one, "hall")
        assert refused.json()["code"] == "rate_limited"
        assert 1 <= int(refused.headers["retry-after"]) <= 60
        version = service.catalog.active_version("hall")
        headers = {"Authorization": f"Bearer {one}"}
        activate = f"/maps/hall/versions/{version}/activate"
        assert service.http.post(activate, headers=headers).status_code == 429, "changes count together"
        assert roll_back(one, "yard").status_code == 200, "another map"
        assert roll_back(other, "hall").status_code == 200, "another caller"
        assert len(service.catalog.log("hall")) == 4 + 3

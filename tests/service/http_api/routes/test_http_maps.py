from __future__ import annotations

from tests.service.service_world import Service, publish
from tests.waiting import wait_until


def test_maps_and_versions_are_listed(service: Service):
    first = service.catalog.active_version("hall")
    second = publish(service.catalog, "hall", "2", service.scratch)
    assert service.http.get("/maps").json() == {
        "maps": [{"map_id": "hall", "active_version": second}],
        "next": None,
    }
    described = service.http.get("/maps/hall").json()
    assert (described["map_id"], described["active_version"], described["versions"]) == ("hall", second, 2)
    assert described["manifest"]["files"]["label.txt"]["bytes"] == 1
    versions = service.http.get("/maps/hall/versions").json()["versions"]
    assert [(v["version"], v["active"]) for v in versions] == [(second, True), (first, False)]
    assert versions[0]["published_time"]


def test_a_deleted_map_is_listed_no_more_and_answers_no_more(service: Service):
    first = service.catalog.active_version("hall")
    second = publish(service.catalog, "hall", "2", service.scratch)
    publish(service.catalog, "attic", "3", service.scratch)
    answer = service.http.delete("/maps/hall")
    assert (answer.status_code, sorted(answer.json()["retired"])) == (200, sorted([first, second]))
    assert [entry["map_id"] for entry in service.http.get("/maps").json()["maps"]] == ["attic"]
    wait_until(lambda: service.http.post("/localize?map=hall", content=b"").status_code != 200)
    assert service.http.get(f"/maps/hall/versions/{second}").status_code == 404
    assert service.http.delete("/maps/hall").status_code == 404
    assert service.http.delete("/maps/cellar").status_code == 404


def test_a_deleted_map_can_be_published_again(service: Service):
    assert service.http.delete("/maps/hall").is_success
    again = publish(service.catalog, "hall", "4", service.scratch)
    assert service.http.get("/maps/hall").json()["active_version"] == again
    wait_until(lambda: service.ask("http").ok and service.ask("http").x == 4)

"""Maps, their versions and patches over HTTP."""

from __future__ import annotations

import hashlib
import os
import time
from pathlib import Path

from firstfix.catalog.manifest import Manifest
from firstfix.catalog.sources import put_source, source_key
from tests.service.service_world import Service, publish
from tests.waiting import wait_until


def test_maps_and_versions_are_listed(service: Service):
    first = service.catalog.active_version("hall")
    second = publish(service.catalog, "hall", "2", service.scratch)
    listed = service.http.get("/maps").json()
    assert [(one["map_id"], one["active_version"]) for one in listed["maps"]] == [("hall", second)]
    assert listed["next"] is None
    assert listed["maps"][0]["published_time"]
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


PNG = b"\x89PNG and so on"


def with_report(service: Service) -> str:
    """A version with a picture and a self-test."""
    folder = service.scratch / "reported"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("7")
    (folder / "preview.png").write_bytes(PNG)
    manifest = Manifest.for_directory(
        folder,
        counts={"templates": 9},
        sensor={"name": "vlp-16"},
        self_test={"success": {"0.2m": 0.9}, "reliability": {"bins": []}, "localizability": [{"x": 1}]},
        bounds=((0, 0, 0), (1, 2, 3)),
    )
    return service.catalog.publish("hall", folder, manifest)


def test_versions_come_in_pages(service: Service):
    made = [service.catalog.active_version("hall")]
    made += [publish(service.catalog, "hall", str(n), service.scratch) for n in range(2, 6)]
    found, after = [], None
    for _ in range(3):
        params = {"limit": 2} if after is None else {"limit": 2, "after": after}
        page = service.http.get("/maps/hall/versions", params=params).json()
        found += [entry["version"] for entry in page["versions"]]
        after = page["next"]
    assert found == made[::-1]
    assert after is None
    assert service.http.get("/maps/hall/versions", params={"after": "0" * 64}).status_code == 404
    assert service.http.get("/maps/hall/versions", params={"limit": 0}).status_code == 400


def test_a_version_has_a_report_and_pictures(service: Service):
    version = with_report(service)
    described = service.http.get(f"/maps/hall/versions/{version}").json()
    assert described["active"]
    assert described["manifest"]["counts"] == {"templates": 9}
    report = service.http.get(f"/maps/hall/versions/{version}/report").json()
    assert report["self_test"]["localizability"] == [{"x": 1}]
    assert report["pictures"] == ["preview"]
    assert report["bounds"] == [[0, 0, 0], [1, 2, 3]]
    picture = service.http.get(f"/maps/hall/versions/{version}/preview")
    assert (picture.content, picture.headers["content-type"]) == (PNG, "image/png")
    assert "immutable" in picture.headers["cache-control"]
    etag = picture.headers["etag"]
    assert etag == f'"{hashlib.sha256(PNG).hexdigest()}"'
    for given in (etag, f"W/{etag}", f'"x", {etag}', "*"):
        again = service.http.get(picture.url, headers={"If-None-Match": given})
        assert (again.status_code, again.content) == (304, b"")
    assert service.http.get(picture.url, headers={"If-None-Match": '"x"'}).status_code == 200
    assert service.http.get(f"/maps/hall/versions/{version}/reliability").status_code == 404
    assert service.http.get(f"/maps/hall/versions/{'0' * 64}/preview").status_code == 404


def test_a_picture_that_was_altered_is_not_shown(service: Service):
    version = with_report(service)
    service.catalog.store.put(f"maps/hall/versions/{version}/preview.png", PNG[:-1] + b"x")
    answer = service.http.get(f"/maps/hall/versions/{version}/preview")
    assert (answer.status_code, answer.json()["code"]) == (503, "corrupt_version")


def test_a_roll_back_can_be_rolled_back(service: Service):
    first = service.catalog.active_version("hall")
    second = publish(service.catalog, "hall", "2", service.scratch)
    answer = service.http.post("/maps/hall/rollback")
    assert answer.json() == {"map_id": "hall", "active_version": first, "serving_version": first}
    assert service.ask("http").x == 1
    assert service.http.post("/maps/hall/rollback").json()["active_version"] == second
    publish(service.catalog, "attic", "3", service.scratch)
    assert service.http.post("/maps/attic/rollback").status_code == 409
    assert service.http.post("/maps/cellar/rollback").status_code == 404


def test_an_active_version_is_retired_by_force_alone(service: Service):
    first = service.catalog.active_version("hall")
    second = publish(service.catalog, "hall", "2", service.scratch)
    refused = service.http.delete(f"/maps/hall/versions/{second}")
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    forced = service.http.delete(f"/maps/hall/versions/{second}", params={"force": "true"})
    assert forced.json() == {"map_id": "hall", "version": second, "active_version": first}
    wait_until(lambda: service.ask("http").x == 1)
    assert service.http.get(f"/maps/hall/versions/{second}").status_code == 404
    last = service.http.delete(f"/maps/hall/versions/{first}", params={"force": "true"})
    assert last.json()["active_version"] is None


def test_garbage_is_collected_over_http(service: Service, tmp_path: Path):
    retired = service.catalog.active_version("hall")
    publish(service.catalog, "hall", "2", service.scratch)
    assert service.http.delete(f"/maps/hall/versions/{retired}").is_success
    kept = service.http.post("/collect-garbage", params={"dry_run": "true"}).json()
    assert kept["dry_run"]
    assert sum(kept["objects"].values()) == 0, "all of it is younger than a day"
    for path in ("/collect-garbage", "/maps/hall/collect-garbage"):
        assert service.http.post(path, params={"older_than_h": "0"}).status_code == 400
    _age(tmp_path / "store", days=2)
    assert service.http.post("/maps/attic/collect-garbage").json()["objects"]["versions"] == 0
    # retired just now, whatever the age of its files: a replica may still serve it
    assert service.http.post("/maps/hall/collect-garbage").json()["objects"]["versions"] == 0
    orphan = tmp_path / "store/maps/hall/versions" / ("0" * 64) / "a.npy"
    orphan.parent.mkdir()
    orphan.write_bytes(b"of a publish that was killed")
    _age(tmp_path / "store", days=2)
    would = service.http.post("/collect-garbage", params={"dry_run": "true"}).json()
    assert would["keys"]["versions"] == [f"maps/hall/versions/{'0' * 64}/a.npy"]
    assert orphan.exists()
    done = service.http.post("/collect-garbage").json()
    assert done["keys"] == would["keys"]
    assert not orphan.exists()


def _age(directory: Path, days: float) -> None:
    """Makes all objects older, except log entries, which carry their own times."""
    then = time.time() - days * 86400
    for path in directory.rglob("*"):
        if path.parent.name != "log":
            os.utime(path, (then, then))


def publish_built(service: Service, patch: str) -> str:
    """Publishes a version of a recorded build, whose config says this of patches."""
    folder = service.scratch / "built"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("1")
    key = source_key("hall", put_source(service.catalog.store, "hall", folder / "label.txt"))
    request = {"map_id": "hall", "source": {"key": key}, "trajectory": None, "config": {"patch": patch}}
    service.catalog.builds.put("b1", request)
    return service.catalog.publish("hall", folder, Manifest.for_directory(folder), build_id="b1")


def test_a_patch_is_recorded_as_a_build(recorder: Service):
    version = publish_built(recorder, "activate")
    answer = recorder.http.post("/maps/hall/patch")
    assert answer.status_code == 202
    build_id = answer.json()["build_id"]
    assert answer.headers["location"] == f"/builds/{build_id}"
    assert answer.json()["state"] == "queued"
    request = recorder.catalog.builds.request(build_id)
    assert request["patch"] == {"base": version, "mode": "activate"}
    assert request["owner"]
    answer = recorder.http.post("/maps/hall/patch", params={"mode": "propose"})
    assert recorder.catalog.builds.request(answer.json()["build_id"])["patch"]["mode"] == "propose"


def test_patches_are_refused_where_they_are_off(recorder: Service):
    assert recorder.http.post("/maps/hall/patch").status_code == 404
    publish_built(recorder, "off")
    answer = recorder.http.post("/maps/hall/patch")
    assert answer.status_code == 409
    assert "patches of map hall are off" in answer.json()["detail"]
    assert recorder.http.post("/maps/hall/patch", params={"mode": "force"}).status_code == 400
    assert recorder.catalog.builds.ids() == ["b1"]

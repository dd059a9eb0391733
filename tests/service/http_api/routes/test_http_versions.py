from __future__ import annotations

import hashlib
import time
from pathlib import Path

from firstfix.catalog.manifest import Manifest
from tests.service.service_world import Service, publish
from tests.waiting import wait_until

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


def test_a_version_its_report_and_its_picture(service: Service):
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


def test_rolling_back_and_forth(service: Service):
    first = service.catalog.active_version("hall")
    second = publish(service.catalog, "hall", "2", service.scratch)
    answer = service.http.post("/maps/hall/rollback")
    assert answer.json() == {"map_id": "hall", "active_version": first, "serving_version": first}
    assert service.ask("http").x == 1
    assert service.http.post("/maps/hall/rollback").json()["active_version"] == second
    publish(service.catalog, "attic", "3", service.scratch)
    assert service.http.post("/maps/attic/rollback").status_code == 409
    assert service.http.post("/maps/cellar/rollback").status_code == 404


def test_retiring_a_version(service: Service):
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
    import os

    then = time.time() - days * 86400
    for path in directory.rglob("*"):
        if path.parent.name != "log":
            os.utime(path, (then, then))

"""Versions by their first characters, wherever a caller names one."""

from __future__ import annotations

import hashlib
from itertools import count

import pytest

from firstfix.catalog.manifest import FileEntry, Manifest
from tests.service.service_world import Service, publish


def version_of(label: str) -> str:
    """The version that ``publish`` makes of a label."""
    entry = FileEntry(len(label), hashlib.sha256(label.encode()).hexdigest())
    return Manifest({"label.txt": entry}).digest


def alike() -> tuple[str, str]:
    """Two labels whose versions have the same first four characters."""
    seen: dict[str, str] = {}
    for label in map(str, count(2)):
        other = seen.setdefault(version_of(label)[:4], label)
        if other != label:
            return other, label
    raise AssertionError


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_a_query_names_a_version_by_its_first_characters(service: Service, transport: str):
    first = service.catalog.active_version("hall")
    assert first is not None
    publish(service.catalog, "hall", "2", service.scratch)
    answer = service.ask(transport, options={"version": first[:8]})
    assert answer.ok, answer.body
    assert answer.x == 1
    assert answer.json["map_version"] == first
    unknown = service.ask(transport, options={"version": "0000"})
    assert unknown.json["code"] == "not_found"
    assert service.ask(transport, options={"version": "abc"}).json["code"] == "invalid_option"


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_first_characters_of_several_versions_are_an_error(service: Service, transport: str):
    labels = alike()
    versions = [publish(service.catalog, "hall", label, service.scratch) for label in labels]
    assert versions[0][:4] == versions[1][:4]
    refused = service.ask(transport, options={"version": versions[0][:4]})
    assert refused.json["code"] == "invalid_option"
    assert "2 versions begin with" in refused.json["detail"]
    assert service.http.get(f"/maps/hall/versions/{versions[0][:4]}").status_code == 400
    for version, label in zip(versions, labels, strict=True):
        assert service.ask(transport, options={"version": version[:12]}).x == float(label)


def test_the_routes_of_versions_take_first_characters(service: Service):
    first = service.catalog.active_version("hall")
    assert first is not None
    second = publish(service.catalog, "hall", "2", service.scratch)
    assert service.http.get(f"/maps/hall/versions/{first[:12]}").json()["version"] == first
    assert service.http.get(f"/maps/hall/versions/{first[:12]}/report").json()["version"] == first
    assert service.http.get("/maps/hall/changes", params={"version": first[:12]}).json()["version"] == first
    assert service.http.post(f"/maps/hall/versions/{first[:12]}/activate").json()["active_version"] == first
    retired = service.http.delete(f"/maps/hall/versions/{second[:12]}").json()
    assert (retired["version"], retired["active_version"]) == (second, first)
    assert service.http.get(f"/maps/hall/versions/{second[:12]}").status_code == 404


def test_a_picture_by_first_characters_is_not_kept_for_ever(service: Service):
    folder = service.scratch / "drawn"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("9")
    (folder / "preview.png").write_bytes(b"a picture")
    version = service.catalog.publish("hall", folder, Manifest.for_directory(folder))
    caching = [
        service.http.get(f"/maps/hall/versions/{given}/preview").headers["cache-control"]
        for given in (version, version[:12])
    ]
    assert "immutable" in caching[0]
    assert caching[1] == "private, no-cache", "tomorrow another version may begin so"

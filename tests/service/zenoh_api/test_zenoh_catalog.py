"""The map list, version changes and replicas as zenoh keys, with one real service and with two."""

from __future__ import annotations

import json
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

import firstfix
from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_client import ZenohClient
from tests.service.service_world import (
    SCAN_BODY,
    XYZ,
    Service,
    client_session,
    free_port,
    publish,
    running_service,
)
from tests.waiting import LIMIT_S, wait_until


def get(service: Service, key: str) -> list[dict[str, Any]]:
    replies = service.session.get(key, timeout=LIMIT_S)
    return [json.loads((reply.ok or reply.err).payload.to_bytes()) for reply in replies]


def served(service: Service) -> dict[str, str]:
    (listed,) = get(service, "firstfix/maps")
    return {one["map_id"]: one["serving_version"] for one in listed["maps"]}


def test_the_maps_are_listed_as_over_http(service: Service):
    publish(service.catalog, "attic", "5", service.scratch)
    wait_until(lambda: set(served(service)) == {"attic", "hall"})
    (listed,) = get(service, "firstfix/maps")
    for one in listed["maps"]:
        assert one.pop("serving_version") == one["active_version"]
    over_http = service.http.get("/maps").json()["maps"]
    assert listed["maps"] == [{name: one[name] for name in ("map_id", "active_version")} for one in over_http]
    with ZenohClient(service.endpoint) as client:
        assert [(one.map_id, one.active_version) for one in client.maps()] == sorted(
            (name, service.catalog.active_version(name)) for name in ("attic", "hall")
        )


def test_a_maps_version_can_be_asked_for(service: Service):
    first = service.catalog.active_version("hall")
    second = publish(service.catalog, "hall", "2", service.scratch)
    wait_until(lambda: served(service) == {"hall": second})
    (versions,) = get(service, "firstfix/hall/version")
    assert versions == {
        "map_id": "hall",
        "version": second,
        "previous": first,
        "serving_version": second,
        "seq": 4,
        "replica": "r1",
    }
    assert get(service, "firstfix/*/version") == [versions]
    (problem,) = get(service, "firstfix/attic/version")
    assert (problem["code"], problem["status"]) == ("not_found", 404)


def test_every_change_is_published(service: Service):
    wait_until(lambda: served(service))
    heard: list[dict[str, Any]] = []
    key = "firstfix/*/version"
    peer = client_session(service.endpoint)
    peer.declare_subscriber(key, lambda sample: heard.append(json.loads(sample.payload.to_bytes())))
    wait_until(lambda: list(peer.get("firstfix/maps", timeout=5)))  # the declaration has arrived before it
    first = str(service.catalog.active_version("hall"))
    second = publish(service.catalog, "hall", "2", service.scratch)
    wait_until(lambda: heard and heard[-1]["serving_version"] == second)
    for version in (first, second):
        service.catalog.retire("hall", version, force=True)
    wait_until(lambda: heard[-1]["version"] is None)
    assert heard[-1]["serving_version"] is None
    assert [one["seq"] for one in heard] == sorted(one["seq"] for one in heard)
    assert {one["replica"] for one in heard} == {"r1"}
    peer.close()


def test_a_refused_version_is_not_the_serving_one(service: Service):
    first = str(service.catalog.active_version("hall"))
    wait_until(lambda: served(service) == {"hall": first})
    bad = publish(service.catalog, "hall", "unreadable", service.scratch)
    wait_until(lambda: get(service, "firstfix/hall/version")[0]["version"] == bad)
    (versions,) = get(service, "firstfix/hall/version")
    assert (versions["serving_version"], versions["previous"]) == (first, first)


def test_a_replica_describes_itself(service: Service):
    wait_until(lambda: served(service))
    (described,) = get(service, "firstfix/@replicas/r1")
    version = service.catalog.active_version("hall")
    assert described == {
        "replica": "r1",
        "service_version": firstfix.__version__,
        "maps": {"hall": version},
        "load": {"queries": 0, "limit": 34},
    }
    assert get(service, "firstfix/@replicas/*") == [described]
    with ZenohClient(service.endpoint) as client:
        (one,) = client.replicas()
        assert (one.replica, one.maps, one.queries, one.limit) == ("r1", {"hall": version}, 0, 34)


def test_a_watch_of_two_replicas_tells_each_change_once(tmp_path: Path):
    listen = f"tcp/127.0.0.1:{free_port()}"
    store = str(tmp_path / "store")
    catalog = Catalog(Store.open(store))
    versions = [publish(catalog, "hall", "0", tmp_path / "made")]
    with (
        running_service(tmp_path / "a", store=store, zenoh_listen=(listen,), replica="r1") as first,
        running_service(tmp_path / "b", store=store, replica="r2", zenoh_connect=(listen,)) as second,
        ZenohClient(listen) as client,
        client.watch_versions(look_every_s=0.2) as watch,
    ):
        changes = [next(watch)]
        for label in (1, 2, 3):
            versions.append(publish(catalog, "hall", str(label), tmp_path / "made"))
            changes.append(next(watch))
            for one in (first, second):
                wait_until(lambda one=one, x=label: one.ask("http").x == x)
        catalog.activate("hall", versions[0])
        changes.append(next(watch))
        publish(catalog, "attic", "9", tmp_path / "made")
        assert next(watch).map_id == "attic"
    told = [change.version for change in changes]
    assert told == [*versions, versions[0]]
    assert [change.previous for change in changes] == [None, *told[:-1]]


def test_a_watch_can_be_closed_from_elsewhere(service: Service):
    with ZenohClient(service.endpoint) as client, ThreadPoolExecutor(1) as threads:
        watch = client.watch_versions()
        assert next(watch).map_id == "hall"
        rest = threads.submit(list, watch)
        watch.close()
        assert rest.result(LIMIT_S) == []


@pytest.mark.parametrize(
    "key", ["firstfix/@any/localize", "firstfix/@any/localize/r1", "firstfix/@any/localize/*"]
)
def test_a_query_for_any_map_is_answered(service: Service, key: str):
    wait_until(lambda: served(service))
    selector = zenoh.Selector(key, {"map": "hall"})
    for asked in (key, selector):
        (reply,) = service.session.get(asked, payload=SCAN_BODY, encoding=XYZ, timeout=LIMIT_S)
        assert json.loads(reply.ok.payload.to_bytes())["map_id"] == "hall"
        assert str(reply.ok.key_expr) == key.replace("*", "r1")
    with ZenohClient(service.endpoint) as client:
        assert client.localize(np.ones((50, 3)), map_id="").map_id == "hall"


@pytest.mark.parametrize(
    ("maps", "code", "text"),
    [
        ("hall,attic", "not_found", "attic"),
        ("hall,-bad-", "invalid_option", "-bad-"),
        (",".join(f"m{i}" for i in range(17)), "invalid_option", "up to 16"),
    ],
)
def test_several_maps_are_named_by_a_parameter(service: Service, maps: str, code: str, text: str):
    selector = zenoh.Selector("firstfix/@any/localize", {"map": maps})
    (reply,) = service.session.get(selector, payload=SCAN_BODY, encoding=XYZ, timeout=LIMIT_S)
    problem = json.loads(reply.err.payload.to_bytes())
    assert problem["code"] == code
    assert text in problem["detail"]
    http = service.http.post(
        "/localize", params={"map": maps}, content=SCAN_BODY, headers={"Content-Type": XYZ}
    )
    assert http.json() == problem


def test_a_key_that_names_its_map_takes_no_others(service: Service):
    reply = service.ask("zenoh", options={"map": "attic"})
    assert reply.json["code"] == "invalid_option"


def test_a_map_may_have_the_name_of_a_key(service: Service):
    for name in ("localize", "version", "maps", "replicas"):
        publish(service.catalog, name, "7", service.scratch)
    wait_until(lambda: len(served(service)) == 5)
    for name in ("localize", "version", "maps", "replicas"):
        assert service.ask("zenoh", map_id=name).x == 7
    assert {one["map_id"] for one in get(service, "firstfix/*/version")} == set(served(service))

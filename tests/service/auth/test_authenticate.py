"""API keys of a running service: the permissions of each, on both transports."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path

import httpx
import numpy as np
import pytest
from fastapi import APIRouter, FastAPI, Request
from fastapi.routing import APIRoute, iter_route_contexts
from starlette.routing import Route

from firstfix.access.api_keys import ApiKeys
from firstfix.access.permissions import Grant, Scope
from firstfix.errors import Forbidden, StoreUnavailable, Unauthorized
from firstfix.store.store import Store
from firstfix_client import Client, ZenohClient
from firstfix_service.app import create_app
from firstfix_service.auth import key_ring
from firstfix_service.auth.key_ring import KeyRing
from firstfix_service.http_api.edge import authorize, check_routes, needs
from firstfix_service.http_api.routes import garbage
from firstfix_service.settings import Settings
from tests.service.access_world import (
    API_PAGE,
    CONSOLE,
    LaterClock,
    ask_zenoh,
    bearer,
    get,
    give,
    known,
    localize,
)
from tests.service.service_world import Service, publish, running_service, serving
from tests.waiting import wait_until

DAY_S = 86400.0


@pytest.fixture
def keys(tmp_path: Path) -> dict[str, str]:
    """Keys made before the service starts, so that it knows them at once."""
    made = ApiKeys(Store.open(str(tmp_path / "store")))
    patterns = {"hall-localize": ("hall", "hall-*")}
    return {
        name: made.create(name, Grant.parse([name.split("-")[-1]], patterns.get(name, ("*",))))[1]
        for name in ("localize", "build", "metrics", "admin", "hall-localize")
    }


@pytest.fixture
def guarded(tmp_path: Path, keys: dict[str, str]) -> Iterator[Service]:
    with running_service(tmp_path, auth="on", keys_refresh_s=0.1) as running:
        for map_id, label in (("hall", "1"), ("attic", "2")):
            publish(running.catalog, map_id, label, running.scratch)
        wait_until(lambda: running.http.get("/readyz").json().get("maps") == 2)
        yield running


def test_every_route_is_behind_the_gate():
    app = create_app(Settings(store="memory://"))
    for route in iter_route_contexts(app.routes):
        assert isinstance(route.original_route, Route), "a mounted app would not be asked"
        if isinstance(route.original_route, APIRoute):
            assert authorize in [dependency.call for dependency in route.dependant.dependencies], route.name
            assert route.body_field is None, "the framework reads such a body before anybody is asked"


def test_few_routes_are_public():
    routes = iter_route_contexts(create_app(Settings(store="memory://")).routes)
    public = {route.path for route in routes if route.endpoint.needs is None}
    assert public - CONSOLE == {"/healthz", "/readyz", "/openapi.json", *API_PAGE}


async def _forgotten(request: Request) -> None:
    """A route whose author did not say what it needs."""


def test_an_app_with_a_route_without_a_scope_does_not_start(monkeypatch: pytest.MonkeyPatch):
    router = APIRouter()
    router.get("/forgotten")(_forgotten)
    monkeypatch.setattr(garbage, "router", router)
    with pytest.raises(TypeError, match="/forgotten does not say"):
        create_app(Settings(store="memory://"))


def test_an_app_with_a_route_without_a_caller_does_not_start():
    app = FastAPI(openapi_url=None)
    app.add_route("/unasked", needs(Scope.BUILD)(lambda request: None))
    with pytest.raises(TypeError, match="/unasked"):
        check_routes(app)


@serving(auth="on", keys_refresh_s=0.1, zenoh=False, maps={})
def test_a_route_without_a_scope_is_for_administrators(service):
    service.app.add_api_route("/forgotten", _forgotten)
    assert get(service, "/forgotten", known(service, "build")).status_code == 403
    assert get(service, "/forgotten", known(service, "admin")).is_success


@pytest.mark.parametrize(
    "value",
    ["", "Bearer", "Basic dXNlcjpwYXNz", "Bearer ffx_x", "Bearer a b", f"Bearer {'x' * 9000}"]
    + ["ffx_0123456789ab_" + "0" * 64, "Bearer ffx_0123456789ab_" + "0" * 64, "Bearer \xff\xfe"],
)
def test_an_invalid_credential_is_refused(guarded: Service, value: str):
    refused = guarded.http.get("/maps", headers={"Authorization": value.encode("latin-1")})
    assert (refused.status_code, refused.json()["code"]) == (401, "unauthorized")
    assert refused.headers["www-authenticate"].startswith("Bearer")


def test_a_key_counts_once_in_its_header_and_with_its_own_secret(guarded: Service, keys: dict[str, str]):
    twice = [("Authorization", f"Bearer {keys['admin']}")] * 2
    mixed = f"{keys['admin'].rpartition('_')[0]}_{keys['localize'].rpartition('_')[2]}"
    for given in ({}, {"headers": twice}, {"params": {"api_key": keys["admin"]}}, {"headers": bearer(mixed)}):
        assert guarded.http.get("/maps", **given).status_code == 401


@pytest.mark.parametrize(
    ("scope", "allowed"),
    [
        ("localize", {"localize", "get_maps"}),
        ("build", {"localize", "get_maps", "build"}),
        ("metrics", {"metrics"}),
        ("admin", {"localize", "get_maps", "build", "metrics"}),
    ],
)
def test_a_scope_allows_its_routes_alone(
    guarded: Service, keys: dict[str, str], scope: str, allowed: set[str]
):
    key = keys[scope]
    answers = {
        "localize": localize(guarded, key),
        "get_maps": get(guarded, "/maps", key),
        "build": get(guarded, "/builds/none", key),
        "metrics": get(guarded, "/metrics", key),
    }
    for what, answer in answers.items():
        if what in allowed:
            assert answer.status_code in (200, 404), what
        else:
            assert (answer.status_code, answer.json()["code"]) == (403, "forbidden"), what


def test_a_key_for_some_maps_sees_no_others(guarded: Service, keys: dict[str, str]):
    key = keys["hall-localize"]
    assert localize(guarded, key).json()["map_id"] == "hall"
    assert [entry["map_id"] for entry in get(guarded, "/maps", key).json()["maps"]] == ["hall"]
    for path in ("/maps/attic", "/maps/attic/versions"):
        assert get(guarded, path, key).status_code == 403
    assert localize(guarded, key, "?map=hall,attic").status_code == 403


def test_a_forbidden_map_looks_like_a_missing_one(guarded: Service, keys: dict[str, str]):
    key = keys["hall-localize"]
    for ask in (
        lambda map_id: localize(guarded, key, f"?map={map_id}"),
        lambda m: get(guarded, f"/maps/{m}", key),
    ):
        there, nowhere = ask("attic"), ask("attix")
        assert there.status_code == nowhere.status_code == 403
        assert there.content.replace(b"attic", b"") == nowhere.content.replace(b"attix", b"")


def test_a_query_without_a_map_searches_only_maps_of_the_caller(guarded: Service, keys: dict[str, str]):
    only_hall = localize(guarded, keys["hall-localize"], "")
    assert only_hall.json()["map_id"] == "hall"
    none = known(guarded, "localize", maps=("yard-*",))
    assert localize(guarded, none, "").status_code == 404


def test_builds_of_other_maps_do_not_exist(guarded: Service, keys: dict[str, str]):
    guarded.catalog.builds.put("b-1", {"map_id": "attic"})
    other = known(guarded, "build", maps=("hall",))
    assert get(guarded, "/builds/b-1", keys["build"]).json()["map_id"] == "attic"
    for method in ("GET", "DELETE"):
        hidden, missing = (
            guarded.http.request(method, f"/builds/{name}", headers=bearer(other)) for name in ("b-1", "b-2")
        )
        assert hidden.status_code == missing.status_code == 404
        assert hidden.content.replace(b"b-1", b"") == missing.content.replace(b"b-2", b"")
    assert not guarded.catalog.builds.is_cancel_requested("b-1")


def test_a_map_is_posted_only_under_a_name_of_the_caller(guarded: Service):
    key = known(guarded, "build", maps=("hall-*",))

    def post(map_id: str) -> httpx.Response:
        return guarded.http.post(
            "/maps",
            data={"map_id": map_id},
            files={"source": ("a.xyz", b"0 0 0\n")},
            headers=bearer(key),
        )

    assert post("attic").status_code == 403
    assert guarded.catalog.builds.ids() == []
    assert post("hall-7").status_code == 202
    named = {"map_id": "attic", "source": {"url": "s3://b/x"}}
    answer = guarded.http.post("/maps", json=named, headers=bearer(key))
    assert answer.status_code == 403


def test_a_key_expires_without_a_look_at_the_store(guarded: Service, monkeypatch: pytest.MonkeyPatch):
    key = known(guarded, "localize", expires=datetime.now(timezone.utc) + timedelta(hours=1))
    monkeypatch.setattr(key_ring, "datetime", LaterClock)
    assert "has expired" in get(guarded, "/maps", key).text


@serving(auth="on", keys_refresh_s=0.05, keys_max_age_s=DAY_S, poll_interval_s=30, zenoh=False)
def test_known_keys_outlive_the_store_for_a_while(service: Service, monkeypatch: pytest.MonkeyPatch):
    key = give(service, "localize")
    wait_until(lambda: localize(service, key).is_success)

    def gone(self: Store, *_: object) -> list[str]:
        raise StoreUnavailable("gone")

    monkeypatch.setattr(Store, "list", gone)
    assert localize(service, key).is_success
    age_s = KeyRing.age_s.fget
    monkeypatch.setattr(KeyRing, "age_s", property(lambda keys: age_s(keys) + DAY_S))
    assert localize(service, key).status_code == 503
    assert localize(service, key).json()["code"] == "store_unavailable"
    monkeypatch.undo()
    wait_until(lambda: localize(service, key).is_success)


def test_zenoh_queries_carry_their_key(guarded: Service, keys: dict[str, str]):
    assert ask_zenoh(guarded, keys["localize"]).ok
    for key, map_id, code in (
        (None, "hall", "unauthorized"),
        ("nonsense", "hall", "unauthorized"),
        ("x" * 20_000, "hall", "unauthorized"),
        (keys["metrics"], "hall", "forbidden"),
        (keys["hall-localize"], "attic", "forbidden"),
        (keys["hall-localize"], "attix", "forbidden"),
    ):
        assert ask_zenoh(guarded, key, map_id).json["code"] == code


@serving(auth="on", zenoh_trusted=True)
def test_a_trusted_zenoh_needs_no_key(service: Service):
    assert ask_zenoh(service, None).ok
    assert localize(service, None).status_code == 401


def test_credentials_are_ignored_where_authentication_is_off(service: Service):
    assert localize(service, "whatever").is_success
    assert ask_zenoh(service, "whatever").ok
    assert get(service, "/metrics", None).is_success


@serving(auth="on", metrics_public=True, zenoh=False, maps={})
def test_metrics_can_be_left_open(service: Service):
    assert get(service, "/metrics", None).is_success
    assert get(service, "/maps", None).status_code == 401


def test_the_clients_send_their_key(guarded: Service, keys: dict[str, str]):
    points = np.random.default_rng(1).uniform(-5, 5, (50, 3))
    with Client(guarded.url, api_key=keys["localize"]) as http:
        assert http.localize(points, map_id="hall").map_id == "hall"
    with Client(guarded.url, api_key="") as http, pytest.raises(Unauthorized):
        http.localize(points, map_id="hall")
    with ZenohClient(guarded.endpoint, api_key=keys["hall-localize"]) as zenoh_client:
        assert zenoh_client.localize(points, map_id="hall").map_id == "hall"
        with pytest.raises(Forbidden):
            zenoh_client.localize(points, map_id="attic")

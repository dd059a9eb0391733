"""A read-only replica: it answers queries and refuses changes."""

from __future__ import annotations

from pathlib import Path

import pytest
from fastapi.routing import iter_route_contexts

from firstfix.access.permissions import Scope
from firstfix.catalog.catalog import Catalog
from firstfix.errors import ReadOnly
from firstfix.store.store import Store
from firstfix_service.app import create_app
from firstfix_service.settings import Settings
from tests.service.service_world import Service, publish, running_service
from tests.waiting import wait_until


@pytest.fixture
def read_only(tmp_path: Path):
    version = publish(Catalog(Store.open(str(tmp_path / "store"))), "hall", "1", tmp_path / "made")
    before = listing(tmp_path)
    with running_service(tmp_path, read_only=True, run_builds=True) as service:
        yield service, version
    assert listing(tmp_path) == before


def listing(tmp_path: Path) -> list[str]:
    return Store.open(str(tmp_path / "store")).list()


@pytest.mark.parametrize("transport", ["http", "zenoh"])
def test_it_answers(read_only: tuple[Service, str], transport: str):
    service, version = read_only
    wait_until(lambda: service.http.get("/readyz").is_success)
    assert service.ask(transport).x == 1
    assert service.http.get("/maps").json()["maps"] == [{"map_id": "hall", "active_version": version}]


def test_it_refuses_changes(read_only: tuple[Service, str]):
    service, version = read_only
    form = {"files": {"source": ("map.pcd", b"points")}, "data": {"map_id": "hall"}}
    for method, path, body in (
        ("POST", "/maps", form),
        ("POST", f"/maps/hall/versions/{version}/activate", {}),
        ("DELETE", "/builds/some-build", {}),
    ):
        response = service.http.request(method, path, **body)
        assert (response.status_code, response.json()["code"]) == (403, "read_only")
        assert "FIRSTFIX_READ_ONLY" in response.json()["detail"]


def test_routes_that_need_no_more_than_to_localize_change_nothing():
    """The edge lets them pass, whatever their method."""
    routes = iter_route_contexts(create_app(Settings(store="memory://")).routes)
    passing = {
        route.path
        for route in routes
        if {"POST", "PUT", "PATCH", "DELETE"} & (route.methods or set())
        and route.endpoint.needs.scope is Scope.LOCALIZE
    }
    assert passing == {"/localize", "/maps/{map_id}/versions/{version}/overlay"}


def test_its_store_refuses_as_well(read_only: tuple[Service, str]):
    service, version = read_only
    store = Store.open(service.settings.store, read_only=service.settings.read_only)
    with pytest.raises(ReadOnly):
        Catalog(store).retire("hall", version, force=True)

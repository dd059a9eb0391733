"""The short way: what it answers, and that the framework takes no part in it."""

from __future__ import annotations

from typing import Any

import pytest
from fastapi import FastAPI, Request, Response
from fastapi.routing import APIRoute, iter_route_contexts
from starlette.routing import Router

from firstfix_service.app import create_app
from firstfix_service.http_api.short_way import DirectRoute, direct_routes
from firstfix_service.settings import Settings
from tests.service.service_world import Service, serving


async def _function(request: Request) -> Response:
    return Response()


def test_queries_and_probes_go_the_short_way():
    routes = create_app(Settings(store="memory://")).routes
    assert set(direct_routes(list(iter_route_contexts(routes)))) == {
        "/localize",
        "/healthz",
        "/readyz",
        "/metrics",
    }


@serving(zenoh=False)
def test_the_framework_takes_no_part(service: Service, monkeypatch: pytest.MonkeyPatch):
    service.wait_until_loaded()

    async def fail(*_: Any) -> None:
        raise AssertionError("the framework's router was asked")

    monkeypatch.setattr(Router, "__call__", fail)
    assert service.ask_http().ok
    assert service.http.get("/healthz").is_success
    assert service.http.get("/maps").status_code == 500, "other routes are the framework's"


@pytest.mark.parametrize("paths", [["/a/{name}"], ["/a", "/a"]])
def test_a_path_that_is_not_one_routes_own_cannot_be_direct(paths: list[str]):
    app = FastAPI()
    for path, kind in zip(paths, (DirectRoute, APIRoute), strict=False):
        app.router.add_api_route(path, _function, route_class_override=kind, methods=["GET"])
    with pytest.raises(TypeError, match="cannot be direct"):
        direct_routes(list(iter_route_contexts(app.routes)))

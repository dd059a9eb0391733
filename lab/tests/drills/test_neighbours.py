"""A caller floods in every way, a moment each: ``firstfix-lab neighbours`` does it for long."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from firstfix_lab.drills.floods import FLOODS
from firstfix_lab.drills.neighbours import neighbours
from firstfix_lab.drills.route_floods import CONNECTIONS, route_floods
from firstfix_service.app import create_app
from firstfix_service.settings import Settings

if TYPE_CHECKING:
    from firstfix_builder.job.build_job import BuildResult

pytestmark = pytest.mark.slow


ROUTES = ("GET /sensors", "GET /recorded-queries", "small scans")  # a constant answer, a list and refusals


@pytest.mark.timeout(1200)
def test_every_query_beside_a_flood_is_answered(coarse_version: BuildResult, tmp_path: Path):
    floods = FLOODS | {name: route_floods()[name] for name in ROUTES}
    figures = neighbours(coarse_version.directory, tmp_path, seconds=1.0, floods=tuple(floods))
    assert figures["floods"].keys() == floods.keys()
    for name, one in figures["floods"].items():
        assert one["robot"]["asked"] == one["robot"]["answered"] > 0, (name, one)
        assert one["flooder"]["connections"] >= floods[name].connections, name


def test_every_route_has_a_flood():
    documented = create_app(Settings(store="memory://")).openapi()["paths"]
    calls = {f"{method.upper()} {path}" for path, methods in documented.items() for method in methods}
    hidden = {"GET /metrics", "GET /openapi.json", "GET /console/{path:path}", "GET /nothing"}
    floods = route_floods()
    assert calls | hidden <= floods.keys()
    assert {one.connections for one in floods.values()} == {CONNECTIONS}

"""The app as a whole: its start, health and document, read-only replicas, and answers made once."""

from __future__ import annotations

import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from fastapi.routing import iter_route_contexts
from pydantic import ValidationError

import firstfix
from firstfix.access.permissions import Scope
from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import BuildConfig
from firstfix.catalog.catalog import Catalog
from firstfix.errors import ReadOnly, StoreUnavailable
from firstfix.ros.media_types import POSE
from firstfix.scan_formats import MEDIA_TYPES
from firstfix.store.store import Store
from firstfix_service.app import create_app
from firstfix_service.http_api.made_once import MadeOnce
from firstfix_service.http_api.schema.api_models import GeoreferenceBody
from firstfix_service.query_workers.answer_form import PARAMETERS
from firstfix_service.settings import Settings
from tests.service.service_world import Behaviour, Service, publish, running_service
from tests.waiting import LIMIT_S, wait_until


def test_health_and_readiness_are_reported(service: Service):
    assert service.http.get("/healthz").json() == {"status": "ok", "version": firstfix.__version__}
    wait_until(lambda: service.http.get("/readyz").status_code == 200)
    wait_until(lambda: service.http.get("/readyz").json()["maps"] == 1)
    details = service.http.get("/readyz").json()
    assert details["catalog"]["error"] is None
    assert details["catalog"]["age_s"] >= 0
    assert details["queries"] == 0


def test_not_ready_until_the_maps_were_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def fails(self: Store, prefix: str = "") -> list[str]:
        raise StoreUnavailable("gone")

    monkeypatch.setattr(Store, "folders", fails)
    with running_service(tmp_path, zenoh=False) as service:
        assert service.http.get("/healthz").is_success
        response = service.http.get("/readyz")
        assert response.status_code == 503
        assert "retry-after" in response.headers
        wait_until(
            lambda: (
                service.http.get("/readyz").json()["detail"]
                == "the catalog cannot be read: store_unavailable"
            )
        )
        monkeypatch.undo()
        wait_until(lambda: service.http.get("/readyz").is_success)


def test_metrics_have_few_labels(service: Service):
    wait_until(lambda: service.ask("http").ok)
    service.ask("zenoh")
    service.ask("http", map_id="attic")
    service.http.get("/maps/some-map-name")
    service.http.get("/never/heard/of")
    service.http.request("BREW", "/maps")
    text = service.http.get("/metrics").text
    for line in (
        'firstfix_localizations_total{transport="http",verdict="localized"} 1.0',
        'firstfix_localizations_total{transport="zenoh",verdict="localized"} 1.0',
        'firstfix_localize_failures_total{code="not_found",transport="http"} 1.0',
        'firstfix_stage_seconds_count{stage="search"} 2.0',
        'firstfix_http_requests_total{method="GET",route="/maps/{map_id}",status="404"} 1.0',
        'firstfix_http_requests_total{method="GET",route="unknown",status="404"} 1.0',
        'firstfix_version_loads_total{result="ok"} 1.0',
        "firstfix_versions_loaded 1.0",
        "firstfix_queries_admitted 0.0",
    ):
        assert line in text
    for name in ("hall", "attic", "some-map-name", "heard", "BREW"):
        assert name not in text


def test_two_apps_in_one_process_have_their_own_metrics(tmp_path: Path):
    with (
        running_service(tmp_path / "a", zenoh=False) as first,
        running_service(tmp_path / "b", zenoh=False) as second,
    ):
        publish(first.catalog, "hall", "1", first.scratch)
        assert first.ask("http").ok
        line = 'firstfix_localizations_total{transport="http",verdict="localized"}'
        assert f"{line} 1.0" in first.http.get("/metrics").text
        assert f"{line} 0.0" in second.http.get("/metrics").text


def test_harmless_request_ids_are_given_back(service: Service):
    assert service.http.get("/healthz", headers={"X-Request-Id": "abc-1"}).headers["x-request-id"] == "abc-1"
    made = service.http.get("/healthz", headers={"X-Request-Id": "a b\t{}"}).headers["x-request-id"]
    assert len(made) == 32


def test_creating_the_app_reads_and_writes_nothing(tmp_path: Path):
    store = tmp_path / "not" / "there"
    create_app(Settings(store=str(store), cache_dir=tmp_path / "c", work_dir=tmp_path / "w"))
    assert list(tmp_path.iterdir()) == []


def test_settings_come_from_the_environment(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(ValidationError, match="store"):
        Settings()
    monkeypatch.setenv("FIRSTFIX_STORE", "/data")
    monkeypatch.setenv("FIRSTFIX_PORT", "9000")
    monkeypatch.setenv("FIRSTFIX_SOURCE_URLS", '["s3://maps/"]')
    settings = Settings()
    assert (settings.store, settings.port, settings.source_urls) == ("/data", 9000, ("s3://maps/",))
    assert settings.host == "127.0.0.1"
    assert not settings.zenoh_enabled
    monkeypatch.setenv("FIRSTFIX_WORKERS", "0")
    with pytest.raises(ValidationError, match="workers"):
        Settings()


def test_every_setting_is_described():
    for name, info in Settings.model_fields.items():
        assert info.description, name


def test_a_started_service_has_not_imported_what_it_does_not_run(tmp_path: Path):
    code = """
import asyncio, sys
from firstfix_service.app import create_app
from firstfix_service import server
from firstfix_service.settings import Settings

async def main(directory):
    app = create_app(Settings(store=f"{directory}/s", cache_dir=f"{directory}/c", work_dir=f"{directory}/w",
                              zenoh=True, zenoh_listen=(), run_builds=True))
    async with app.router.lifespan_context(app):
        while not {"zenoh", "firstfix.native"} <= set(sys.modules):  # a busy machine loads them later
            await asyncio.sleep(0.02)
        await asyncio.sleep(0.3)
        heavy = {"open3d", "scipy", "faiss", "rich", "pygments", "httpx"}
        heavy |= {"firstfix_builder", "firstfix_client"}
        heavy &= set(sys.modules)
    print("heavy:", sorted(heavy))

asyncio.run(main(sys.argv[1]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, timeout=LIMIT_S
    )
    assert done.returncode == 0, done.stderr
    assert "heavy: []" in done.stdout


def test_a_service_that_cannot_start_prints_one_line(tmp_path: Path):
    (tmp_path / "file").write_text("no directory")
    code = """
import sys
from firstfix_service.server import serve
from firstfix_service.settings import Settings
serve(Settings(store=sys.argv[1] + "/file/store", port=0))
"""
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode != 0
    assert "cannot start: no directory" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_service_starts_with_a_corrupt_version(tmp_path: Path):
    behaviour = Behaviour()
    with running_service(tmp_path, zenoh=False, behaviour=behaviour) as service:
        publish(service.catalog, "cellar", "unreadable", service.scratch)
        publish(service.catalog, "hall", "1", service.scratch)
    with running_service(tmp_path, zenoh=False) as service:
        wait_until(lambda: service.http.get("/readyz").is_success)
        assert service.ask("http").ok
        bad = service.ask("http", map_id="cellar")
        assert (bad.json["code"], bad.json["status"]) == ("corrupt_version", 503)


DOCUMENT = create_app(Settings(store="memory://")).openapi()
CALLS = [(path, method) for path, methods in DOCUMENT["paths"].items() for method in methods]


@pytest.mark.parametrize(("path", "method"), CALLS)
def test_every_call_is_described_with_its_answers(path: str, method: str):
    call = DOCUMENT["paths"][path][method]
    assert call["description"], "its docstring"
    assert "application/problem+json" in call["responses"]["default"]["content"]
    good = {code: answer for code, answer in call["responses"].items() if code.startswith("2")}
    assert len(good) == 1
    ((code, answer),) = good.items()
    if code != "204" and method != "head":
        for media_type, content in answer["content"].items():
            assert content.get("schema"), f"{media_type} without a form"
    for parameter in call.get("parameters", ()):
        assert parameter.get("description"), parameter["name"]


def test_a_query_is_described_with_every_option_and_encoding():
    localize = DOCUMENT["paths"]["/localize"]["post"]
    names = {parameter["name"] for parameter in localize["parameters"]}
    assert names == {"map", "X-Robot", *LocalizeOptions.__dataclass_fields__, *PARAMETERS}
    assert set(localize["requestBody"]["content"]) == set(MEDIA_TYPES)
    assert POSE in localize["responses"]["200"]["content"]
    posted = DOCUMENT["paths"]["/maps"]["post"]["requestBody"]["content"]
    assert set(posted) == {"multipart/form-data", "application/json"}


def test_every_reference_has_its_schema():
    schemas = set(DOCUMENT["components"]["schemas"])

    def references(value: Any) -> set[str]:
        if isinstance(value, dict):
            own = {value["$ref"].rsplit("/", 1)[-1]} if isinstance(value.get("$ref"), str) else set()
            return own.union(*map(references, value.values()))
        return set().union(*map(references, value)) if isinstance(value, list) else set()

    assert references(DOCUMENT) <= schemas


@pytest.mark.parametrize("name", ["MapSummary", "VersionSummary", "Activation", "Build", "Answer", "GeoPose"])
def test_common_answers_have_examples(name: str):
    assert DOCUMENT["components"]["schemas"][name]["examples"]


def test_the_examples_are_valid():
    for example in DOCUMENT["components"]["schemas"]["GeoreferenceBody"]["examples"]:
        GeoreferenceBody.model_validate(example)
    body = DOCUMENT["paths"]["/maps"]["post"]["requestBody"]["content"]["application/json"]
    for example in body["examples"].values():
        BuildConfig.parse(example["value"].get("config", {}))


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
def test_a_read_only_service_answers_queries(read_only: tuple[Service, str], transport: str):
    service, version = read_only
    wait_until(lambda: service.http.get("/readyz").is_success)
    assert service.ask(transport).x == 1
    (listed,) = service.http.get("/maps").json()["maps"]
    assert (listed["map_id"], listed["active_version"]) == ("hall", version)


def test_a_read_only_service_refuses_changes(read_only: tuple[Service, str]):
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


def test_few_routes_of_the_scope_localize_may_change_something():
    """The edge lets them pass, whatever their method."""
    routes = iter_route_contexts(create_app(Settings(store="memory://")).routes)
    passing = {
        route.path
        for route in routes
        if {"POST", "PUT", "PATCH", "DELETE"} & (route.methods or set())
        and route.endpoint.needs is not None
        and route.endpoint.needs.scope is Scope.LOCALIZE
    }
    # they compute, and change nothing
    of_the_console = {"/maps/{map_id}/versions/{version}/overlay", "/scan-report"}
    assert passing - of_the_console == {"/localize"}


def test_a_read_only_store_refuses_changes(read_only: tuple[Service, str]):
    service, version = read_only
    store = Store.open(service.settings.store, read_only=service.settings.read_only)
    with pytest.raises(ReadOnly):
        Catalog(store).retire("hall", version, force=True)


@dataclass(frozen=True)
class Made:
    number: int
    size_bytes: int = 1


class Maker:
    """Counts what it makes."""

    def __init__(self, size_bytes: int = 1) -> None:
        self.count, self.size_bytes = 0, size_bytes

    def __call__(self) -> Made:
        self.count += 1
        return Made(self.count, self.size_bytes)


def test_one_answer_is_made_for_each_key_and_state():
    kept: MadeOnce[Made] = MadeOnce(10, 100)
    make = Maker()
    found = [kept.of(key, state, make).number for key, state in (("a", 1), ("a", 1), ("b", 1), ("a", 2))]
    assert found == [1, 1, 2, 3]
    assert kept.of("b", 1, make).number == 2
    assert kept.of("a", 2, make).number == 3


def test_concurrent_callers_share_one_made_answer():
    kept: MadeOnce[Made] = MadeOnce(10, 100)
    make, together = Maker(), threading.Barrier(4)

    def ask(_: int) -> int:
        together.wait()
        return kept.of("a", 1, make).number

    with ThreadPoolExecutor(4) as threads:
        assert set(threads.map(ask, range(4))) == {1}


@pytest.mark.parametrize(("most", "max_bytes"), [(2, 100), (10, 70)])
def test_the_least_recently_used_answers_are_dropped(most: int, max_bytes: int):
    kept: MadeOnce[Made] = MadeOnce(most, max_bytes)
    make = Maker(size_bytes=30)
    for key in ("a", "b", "a", "c"):
        kept.of(key, 1, make)
    assert make.count == 3
    kept.of("a", 1, make)
    assert make.count == 3
    kept.of("b", 1, make)
    assert make.count == 4


def test_one_answer_over_the_limit_is_kept_alone():
    kept: MadeOnce[Made] = MadeOnce(10, 10)
    make = Maker(size_bytes=30)
    for _ in range(3):
        kept.of("a", 1, make)
    assert make.count == 1


def test_an_answer_is_made_again_after_an_error():
    kept: MadeOnce[Made] = MadeOnce(10, 10)

    def fail() -> Made:
        raise OSError("no store")

    with pytest.raises(OSError, match="no store"):
        kept.of("a", 1, fail)
    assert kept.of("a", 1, Maker()).number == 1

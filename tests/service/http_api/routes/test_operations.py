from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from pydantic import ValidationError

import firstfix
from firstfix.answer.options import LocalizeOptions
from firstfix.decode import MEDIA_TYPES
from firstfix.errors import StoreUnavailable
from firstfix.store.store import Store
from firstfix_service.app import create_app
from firstfix_service.query_workers.answer_form import PARAMETERS
from firstfix_service.settings import Settings
from tests.service.service_world import Behaviour, Service, publish, running_service
from tests.waiting import LIMIT_S, wait_until


def test_alive_and_ready(service: Service):
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


def test_two_apps_in_one_process_do_not_mix(tmp_path: Path):
    with (
        running_service(tmp_path / "a", zenoh=False) as first,
        running_service(tmp_path / "b", zenoh=False) as second,
    ):
        publish(first.catalog, "hall", "1", first.scratch)
        assert first.ask("http").ok
        line = 'firstfix_localizations_total{transport="http",verdict="localized"}'
        assert f"{line} 1.0" in first.http.get("/metrics").text
        assert f"{line} 0.0" in second.http.get("/metrics").text


def test_request_ids_are_given_back(service: Service):
    assert service.http.get("/healthz", headers={"X-Request-Id": "abc-1"}).headers["x-request-id"] == "abc-1"
    made = service.http.get("/healthz", headers={"X-Request-Id": "a b\t{}"}).headers["x-request-id"]
    assert len(made) == 32


def test_the_document_describes_every_option_and_encoding(service: Service):
    document = service.http.get("/openapi.json").json()
    localize = document["paths"]["/localize"]["post"]
    names = {parameter["name"] for parameter in localize["parameters"]}
    assert names == {"map", *LocalizeOptions.__dataclass_fields__, *PARAMETERS}
    assert set(localize["requestBody"]["content"]) == set(MEDIA_TYPES)
    assert set(document["paths"]["/maps"]["post"]["requestBody"]["content"]) == {
        "multipart/form-data",
        "application/json",
    }
    for path, methods in document["paths"].items():
        for method, operation in methods.items():
            assert "application/problem+json" in operation["responses"]["default"]["content"], (path, method)


def test_nothing_is_read_or_made_before_the_start(tmp_path: Path):
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


def test_a_started_service_has_no_mesh_tool_in_it(tmp_path: Path):
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
        heavy = {"open3d", "firstfix_builder", "firstfix_client"} & set(sys.modules)
    print("heavy:", sorted(heavy))

asyncio.run(main(sys.argv[1]))
"""
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, timeout=LIMIT_S
    )
    assert done.returncode == 0, done.stderr
    assert "heavy: []" in done.stdout


def test_a_service_that_cannot_start_says_why_in_one_line(tmp_path: Path):
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


def test_a_version_that_is_bad_does_not_keep_the_service_from_starting(tmp_path: Path):
    behaviour = Behaviour()
    with running_service(tmp_path, zenoh=False, behaviour=behaviour) as service:
        publish(service.catalog, "cellar", "unreadable", service.scratch)
        publish(service.catalog, "hall", "1", service.scratch)
    with running_service(tmp_path, zenoh=False) as service:
        wait_until(lambda: service.http.get("/readyz").is_success)
        assert service.ask("http").ok
        bad = service.ask("http", map_id="cellar")
        assert (bad.json["code"], bad.json["status"]) == ("corrupt_version", 503)

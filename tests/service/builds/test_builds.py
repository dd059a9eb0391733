"""Builds by the fake build process, over HTTP."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

from firstfix.builds.options import BuildOptions, ExitCode
from firstfix.builds.records import FINAL_STATES
from firstfix.catalog.manifest import Manifest
from firstfix.maintenance.rebuild import rebuild
from firstfix.store.json_record import record_json
from firstfix.store.store import Store
from firstfix_builder.job.build_job import BuildJob, BuildResult
from firstfix_builder.job.run_build import run_build
from firstfix_client import BuildStatus
from firstfix_service.builds.process import NICENESS
from tests.service.builds_world import CLOUD, building_service, order, status_of, upload, wait_until_ended
from tests.service.service_world import Service, publish, running_service, serving
from tests.waiting import let_pass, wait_until


def test_a_posted_map_is_durable_before_it_is_answered(recorder: Service):
    response = upload(recorder, level=False)
    assert response.status_code == 202
    assert int(response.headers["retry-after"]) >= 1
    build_id = response.headers["location"].removeprefix("/builds/")
    assert response.json()["build_id"] == build_id
    request = recorder.catalog.builds.request(build_id)
    assert request["file_name"] == "hall_map.xyz", "no path, no space"
    assert request["config"]["level"] is False
    assert request["source"]["key"].endswith(hashlib.sha256(CLOUD).hexdigest())
    assert recorder.catalog.store.get(request["source"]["key"]) == CLOUD
    assert recorder.catalog.store.get(request["trajectory"]["key"]).startswith(b"0 0 0")
    answer = recorder.http.get(response.headers["location"])
    assert answer.json()["state"] == "queued"
    assert int(answer.headers["retry-after"]) >= 1
    assert list((recorder.settings.work_dir / "uploads").iterdir()) == [], "nothing stays on this disk"


def test_the_build_process_runs_at_low_priority(tmp_path: Path):
    with building_service(tmp_path) as service:
        ended = wait_until_ended(service, upload(service))
        assert (ended["state"], ended["version"], ended["progress"]) == ("succeeded", "a" * 64, 1.0)
        niceness = int((tmp_path / "work/order.txt").read_text().split()[1])
        assert niceness >= NICENESS
        line = 'firstfix_builds_total{state="succeeded"} 1.0'
        # counted just after the build process reports its end
        wait_until(lambda: line in service.http.get("/metrics").text)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("do", "code", "detail"),
    [
        ("die", "build_failed", "the reason it died"),
        (
            "killed",
            "build_attempts_exceeded",
            "3 attempts failed without progress; the last one in the stage describe",
        ),
        ("killed", "build_attempts_exceeded", "SIGKILL (out of memory?)"),
    ],
)
def test_a_worker_that_dies_fails_its_build_and_no_other(tmp_path: Path, do: str, code: str, detail: str):
    with building_service(tmp_path) as service:
        died, after = upload(service, do=do), upload(service, "next")
        ended = wait_until_ended(service, died)
        assert ended["state"] == "failed"
        assert ended["error"]["code"] == code
        assert detail in ended["error"]["detail"]
        assert ended["stage"] == "describe", "as far as it came"
        if do == "die":
            log = service.http.get(f"{died.headers['location']}/log")
            assert log.text.splitlines() == ["something to say", "the reason it died"]
            assert log.headers["content-type"].startswith("text/plain")
        assert wait_until_ended(service, after)["state"] == "succeeded"


@pytest.mark.parametrize("do", ["killed_once", pytest.param("again", marks=pytest.mark.slow)])
def test_a_killed_worker_or_one_that_asks_for_it_is_run_again(tmp_path: Path, do: str):
    with building_service(tmp_path) as service:
        assert wait_until_ended(service, upload(service, do=do))["state"] == "succeeded"
    assert order(tmp_path / "work") == ["hall"] * 2


def test_a_missing_worker_fails_the_build(tmp_path: Path):
    with building_service(tmp_path, build_command=("/nowhere/worker",)) as service:
        ended = wait_until_ended(service, upload(service))
        assert "the build command cannot be run" in ended["error"]["detail"]


@pytest.mark.slow
def test_a_build_without_space_is_run_a_few_times_and_then_fails(tmp_path, monkeypatch, capfd):
    monkeypatch.setattr("firstfix_service.builds.runner.PAUSES_S", (0.1, 0.2, 0.4))
    with building_service(tmp_path) as service:
        full = upload(service, "full", do="no_space")
        wait_until(lambda: (status_of(service, full)["error"] or {}).get("code") == "out_of_space")
        other = wait_until_ended(service, upload(service, "other"))
        assert other["state"] == "succeeded", "the queue does not wait for space"
        ended = wait_until_ended(service, full)
        assert (ended["state"], ended["error"]["code"]) == ("failed", "out_of_space")
        assert "needs 9 bytes" in ended["error"]["detail"]
        assert "3 bytes are free" in ended["error"]["detail"]
        wait_until(lambda: service.catalog.store.list("maps/full/sources") == [])
    assert order(tmp_path / "work").count("full") == 4
    assert capfd.readouterr().out.count("a build was put back") == 3


def test_a_restart_resumes_running_and_waiting_builds(tmp_path: Path):
    with building_service(tmp_path) as service:
        ran, waited = upload(service, "ran", do="hang_once"), upload(service, "waited")
        wait_until(lambda: (tmp_path / "work/hung").exists())
        assert status_of(service, ran)["state"] == "running"
        assert status_of(service, waited)["state"] == "queued"
    with building_service(tmp_path) as service:
        assert wait_until_ended(service, ran)["state"] == "succeeded"
        assert wait_until_ended(service, waited)["state"] == "succeeded"
    assert order(tmp_path / "work") == ["ran", "ran", "waited"], (
        "the first service did not wait for the build, which hung"
    )


def test_running_and_waiting_builds_are_cancelled(tmp_path: Path):
    with building_service(tmp_path) as service:
        publish(service.catalog, "hall", "1", service.scratch)
        running, waiting = upload(service, do="until_cancelled"), upload(service, "waiting")
        wait_until(lambda: status_of(service, running)["state"] == "running")
        assert service.ask("http").ok, "queries are answered while a build runs"
        cancelled = service.http.delete(waiting.headers["location"])
        assert (cancelled.status_code, cancelled.json()["state"]) == (202, "cancelled")
        assert service.http.delete(running.headers["location"]).status_code == 202
        assert wait_until_ended(service, running)["state"] == "cancelled"
        again = service.http.delete(running.headers["location"])
        assert (again.status_code, again.json()["code"]) == (409, "conflict")
        assert wait_until_ended(service, upload(service, "after"))["state"] == "succeeded"
    assert "waiting" not in (tmp_path / "work/order.txt").read_text()


def test_a_source_url_must_be_allowed(tmp_path: Path):
    body = {"map_id": "hall", "source": {"url": "s3://maps/hall.laz"}, "config": {"level": False}}
    with running_service(tmp_path / "a", zenoh=False) as service:
        response = service.http.post("/maps", json=body)
        assert (response.status_code, response.json()["code"]) == (400, "invalid_option")
        assert service.catalog.builds.ids() == []
    with running_service(tmp_path / "b", zenoh=False, source_urls=("s3://maps/",)) as service:
        response = service.http.post("/maps", json={**body, "trajectory": {"url": "s3://maps/tracks/t.txt"}})
        assert response.status_code == 202
        assert service.catalog.builds.request(response.json()["build_id"]) == {
            "map_id": "hall",
            "source": {"url": "s3://maps/hall.laz"},
            "file_name": "hall.laz",
            "trajectory": {"url": "s3://maps/tracks/t.txt", "file_name": "t.txt"},
            "config": {"level": False},
            "owner": "address:127.0.0.1",
        }


def test_the_worker_gets_the_allowed_source_servers(tmp_path: Path):
    allowed = ("s3://maps/", "https://files.example.org/maps/")
    with building_service(tmp_path, source_urls=allowed) as service:
        assert wait_until_ended(service, upload(service))["state"] == "succeeded"
    assert (tmp_path / "work/source_urls.txt").read_text() == "https://files.example.org/maps/"


@pytest.mark.parametrize(
    ("body", "code"),
    [
        (b"{", "malformed_data"),
        (b"[1]", "malformed_data"),
        (b"[" * 100_000, "malformed_data"),
        (b'{"map_id": "hall"}', "invalid_option"),
        (b'{"map_id": "hall", "source": "s3://maps/x"}', "invalid_option"),
        (b'{"map_id": "hall", "source": {"url": 7}}', "invalid_option"),
        (b'{"map_id": "hall", "source": {"url": "s3://maps/x"}, "speed": 1}', "invalid_option"),
        (b'{"map_id": "../x", "source": {"url": "s3://maps/x"}}', "invalid_option"),
        (b'{"map_id": "hall", "source": {"url": "s3://maps/x"}, "config": [1]}', "invalid_option"),
        (b" " * 2_000_000, "too_large"),
    ],
)
def test_invalid_json_is_refused(shared_service: Service, body: bytes, code: str):
    response = shared_service.http.post("/maps", content=body, headers={"Content-Type": "application/json"})
    assert (response.json()["status"], response.json()["code"]) == (response.status_code, code)
    assert shared_service.catalog.builds.ids() == []


def form(*fields: tuple[str, str | None, bytes], end: bytes = b"--b--\r\n") -> bytes:
    parts = []
    for name, file_name, content in fields:
        extra = "" if file_name is None else f'; filename="{file_name}"'
        head = f'--b\r\nContent-Disposition: form-data; name="{name}"{extra}\r\n\r\n'
        parts.append(head.encode() + content + b"\r\n")
    return b"".join(parts) + end


GOOD = (("map_id", None, b"hall"), ("source", "x.xyz", CLOUD))


@serving(zenoh=False, max_upload_bytes=8 << 20, maps={})
@pytest.mark.parametrize(
    ("body", "code"),
    [
        (form(*GOOD), None),
        (form(*GOOD, end=b""), "malformed_data"),
        (form(("map_id", None, b"hall")), "invalid_option"),
        (form(("source", "x.xyz", CLOUD)), "invalid_option"),
        (form(*GOOD, ("config", None, b"{")), "malformed_data"),
        (form(*GOOD, ("config", None, b"[]")), "malformed_data"),
        (form(*GOOD, ("speed", None, b"1")), "invalid_option"),
        (form(*GOOD, ("map_id", None, b"attic")), "invalid_option"),
        (form(("map_id", None, b"../../x"), GOOD[1]), "invalid_option"),
        (form(("map_id", None, b"\xff"), GOOD[1]), "malformed_data"),
        (form(*GOOD, ("config", None, b" " * (2 << 20))), "too_large"),
        (form(*GOOD, ("trajectory", "t", bytes(9 << 20))), "too_large"),
        (b"no form at all", "malformed_data"),
        (b"", "malformed_data"),
    ],
)
def test_invalid_forms_are_refused_and_leave_no_file(service: Service, body: bytes, code: str | None):
    headers = {"Content-Type": "multipart/form-data; boundary=b"}
    response = service.http.post("/maps", content=body, headers=headers)
    assert response.json().get("code") == code
    assert len(service.catalog.builds.ids()) == (1 if code is None else 0)
    assert list(service.settings.work_dir.glob("uploads/*")) == []


def test_a_form_without_a_boundary_is_refused(recorder: Service):
    response = recorder.http.post("/maps", content=b"x", headers={"Content-Type": "multipart/form-data"})
    assert response.json()["code"] == "malformed_data"


def test_a_file_larger_than_a_batch_arrives_unchanged(recorder: Service):
    data = bytes(range(256)) * (20 << 10)  # 5 MiB
    response = recorder.http.post("/maps", data={"map_id": "hall"}, files={"source": ("a.bin", data)})
    request = recorder.catalog.builds.request(response.json()["build_id"])
    assert recorder.catalog.store.get(request["source"]["key"]) == data
    assert request["trajectory"] is None


def test_a_map_is_rebuilt_from_its_kept_source(tmp_path: Path):
    (tmp_path / "made").mkdir()
    manifest = Manifest.for_directory(tmp_path / "made")
    with building_service(tmp_path) as service:
        first = wait_until_ended(service, upload(service))
        # the fake worker publishes nothing
        service.catalog.publish("hall", tmp_path / "made", manifest, build_id=first["build_id"])
        build_id = rebuild(service.catalog, "hall")
        wait_until(lambda: service.catalog.builds.status(build_id)["state"] in FINAL_STATES)
        assert service.catalog.builds.status(build_id)["state"] == "succeeded"


def test_a_damaged_record_delays_no_other_build(tmp_path: Path):
    store = Store.open(str(tmp_path / "store"))
    store.put("builds/a-broken-request/request.json", b"{")
    store.put("builds/a-broken-status/request.json", record_json({"map_id": "hall"}))
    store.put("builds/a-broken-status/status.json", b"")
    with building_service(tmp_path) as service:
        assert wait_until_ended(service, upload(service))["state"] == "succeeded"


def built(service: Service, label: str, found: float, **config: object) -> dict[str, object]:
    """The status of a build of the map "hall", whose version answers x = label."""

    def build_version(job: BuildJob) -> BuildResult:
        directory = job.work / f"version-{label}"
        directory.mkdir(parents=True)
        (directory / "label.txt").write_text(label)
        tested = {"queries": 120, "found": found, "success": {"1m": found}}
        return BuildResult(directory, Manifest.for_directory(directory, self_test=tested))

    response = upload(service, **config)
    options = BuildOptions(
        store=service.settings.store,
        build_id=response.json()["build_id"],
        work=service.settings.work_dir / f"build-{label}",
        provisional=False,
    )
    assert run_build(options, build_version) is ExitCode.SUCCEEDED
    return status_of(service, response)


def served(service: Service) -> float:
    return service.ask_http().x


@serving(zenoh=False, maps={})
def test_a_version_with_a_bad_self_test_is_not_activated(service: Service):
    good = built(service, "1", 0.9)
    assert (good["activated"], good["findings"]) == (True, [])
    wait_until(lambda: service.http.get("/maps/hall").status_code == 200)
    assert served(service) == 1.0

    bad = built(service, "2", 0.3)
    assert bad["state"] == "succeeded"
    assert bad["activated"] is False
    (finding,) = bad["findings"]
    assert finding["code"] == "self_test_low"
    assert finding["numbers"] == {"found": 0.3, "least": 0.7}
    assert f"firstfix maps activate hall {bad['version']}" in finding["remedy"]
    assert BuildStatus.from_mapping("b", bad).findings[0].code == "self_test_low"
    events = service.http.get(f"/builds/{bad['build_id']}/events").text
    last = json.loads(events.rpartition("data: ")[2])
    assert [{"places": [], **one} for one in last["findings"]] == bad["findings"]
    let_pass(0.5)  # a few polls
    assert served(service) == 1.0
    versions = service.http.get("/maps/hall/versions").json()["versions"]
    assert {one["version"]: one["active"] for one in versions} == {
        good["version"]: True,
        bad["version"]: False,
    }

    assert service.http.post(f"/maps/hall/versions/{bad['version']}/activate").status_code == 200
    assert served(service) == 2.0, "a person decides otherwise"


@serving(zenoh=False, maps={})
def test_the_options_of_the_build_lower_the_threshold(service: Service):
    assert built(service, "1", 0.3, activate={"min_found": 0.2})["activated"] is True
    wait_until(lambda: service.http.get("/maps/hall").status_code == 200)
    assert served(service) == 1.0

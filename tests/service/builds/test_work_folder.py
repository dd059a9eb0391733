"""Work folders: one for each store, and what is told where another process has a service's."""

from __future__ import annotations

import json
import os
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from firstfix.errors import FirstfixError
from firstfix.store.url import StoreUrl
from firstfix_cli.main import run
from firstfix_cli.remote_build import remote_build
from firstfix_cli.stage_bars import stage_bars
from firstfix_client import Client
from firstfix_service.builds import work_folder
from firstfix_service.builds.queue import NOBODY_BUILDS
from firstfix_service.builds.work_folder import Holder, WorkFolder
from firstfix_service.settings import Settings
from tests.service.builds_world import CLOUD, building_service, status_of, upload, wait_until_ended
from tests.service.service_world import Service, running_service
from tests.waiting import let_pass, wait_until

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(work_folder, "WAIT_S", 0.05)


@pytest.fixture
def cache_home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache home"))
    return tmp_path / "cache home"


def taken(path: Path, store: Path) -> WorkFolder:
    found = WorkFolder.take(path, StoreUrl.parse(str(store)).identity())
    assert isinstance(found, WorkFolder)
    return found


def ended(arguments: list[object]) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)


def waits_for(service: Service) -> Any:
    return service.http.get("/readyz").json().get("builds_wait_for")


def test_two_services_of_one_user_build_for_two_stores(tmp_path: Path, cache_home: Path):
    with (
        building_service(tmp_path / "a", work_dir=None) as one,
        building_service(tmp_path / "b", work_dir=None) as other,
    ):
        for service in (one, other):
            assert wait_until_ended(service, upload(service))["state"] == "succeeded"
            assert waits_for(service) is None
    folders = sorted(cache_home.glob("firstfix/work/*/queue.lock"))
    assert [lock.parent for lock in folders] == sorted([one.settings.work_dir, other.settings.work_dir])


def test_the_default_folder_is_that_of_the_store(tmp_path: Path, cache_home: Path):
    (tmp_path / "maps").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "maps")
    (tmp_path / "x").mkdir()
    maps = str(tmp_path / "maps")
    same = [maps, f"file://{maps}", str(tmp_path / "link"), f"{tmp_path}/x/../maps/"]
    found = {Settings(store=store).work_dir for store in same}
    assert len(found) == 1
    assert next(iter(found)).parent == cache_home / "firstfix" / "work"
    assert Settings(store=str(tmp_path / "other")).work_dir not in found
    assert Settings(store="ftp://nothing").work_dir == cache_home / "firstfix" / "work", "refused later"


def test_a_folder_that_is_given_stays_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    assert Settings(store="s3://maps", work_dir=tmp_path).work_dir == tmp_path
    monkeypatch.setenv("FIRSTFIX_WORK_DIR", str(tmp_path / "mine"))
    assert Settings(store="s3://maps").work_dir == tmp_path / "mine"


def test_builds_that_wait_for_the_process_of_another_store_say_so(tmp_path: Path):
    folder = taken(tmp_path / "work", tmp_path / "other store")
    with capture_logs() as lines, building_service(tmp_path) as service:
        wait_until(lambda: waits_for(service) is not None)
        assert service.http.get("/readyz").status_code == 200, "queries are answered"
        response = upload(service)
        shown = [
            response.json()["waits_for"],
            status_of(service, response)["waits_for"],
            service.http.get("/builds").json()["builds"][0]["waits_for"],
            waits_for(service),
        ]
        assert shown == [shown[0]] * 4
        assert "another process runs builds of another store" in shown[0]
        assert "FIRSTFIX_WORK_DIR" in shown[0]
        assert str(tmp_path) not in shown[0]
        with service.http.stream("GET", f"{response.headers['location']}/events") as events:
            text = next(line for line in events.iter_lines() if line.startswith("data: "))
        assert json.loads(text.removeprefix("data: "))["waits_for"] == shown[0]
        with Client(service.url) as client:
            assert client.build_status(response.json()["build_id"]).waits_for == shown[0]
        told = [line for line in lines if line["event"] == "builds wait"]
        assert len(told) == 1, "not again and again"
        assert (told[0]["log_level"], told[0]["pid"]) == ("warning", os.getpid())
        assert "other store" in told[0]["others_store"]
        folder.release()
        ended = wait_until_ended(service, response)
        assert (ended["state"], ended["waits_for"]) == ("succeeded", None)
        assert waits_for(service) is None


def test_the_shell_says_what_a_build_waits_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    source = tmp_path / "map.xyz"
    source.write_bytes(CLOUD)
    folder = taken(tmp_path / "work", tmp_path / "other store")
    with building_service(tmp_path) as service:
        wait_until(lambda: waits_for(service) is not None)
        why = waits_for(service)
        ended(["build", source, "--map-id", "hall", "--url", service.url, "--no-wait"])
        assert f"is queued\nit waits: {why}\n" in capsys.readouterr().out
        said: list[str] = []

        class Shown:
            def __call__(self, stage: str, fraction: float) -> None:
                pass

            def say(self, line: str) -> None:
                said.append(line)
                folder.release()

        config = {"sensor": {"preset": "vlp-16", "name": "succeed"}}
        with suppress(FirstfixError):  # the fake build process makes no version that has a report
            remote_build(source, "hall", config, None, service.url, lambda: nullcontext(Shown()), wait=True)
    assert said == [f"the build waits: {why}"]


def test_a_line_is_shown_above_the_stages(capsys: pytest.CaptureFixture[str]):
    with stage_bars() as bars:
        bars("queued", 0.0)
        bars.say("the build waits: [another] process")
    assert "the build waits: [another] process" in capsys.readouterr().err


def test_builds_that_another_process_of_the_store_runs_do_not_wait(tmp_path: Path):
    folder = taken(tmp_path / "work", tmp_path / "store")
    with capture_logs() as lines, building_service(tmp_path) as service:
        wait_until(lambda: any("runs the builds of this store" in line["event"] for line in lines))
        response = upload(service)
        assert status_of(service, response)["waits_for"] is None
        assert waits_for(service) is None
        assert not [line for line in lines if line["event"] == "builds wait"]
        folder.release()
        assert wait_until_ended(service, response)["state"] == "succeeded"


def test_builds_wait_for_a_process_that_has_not_said_whose_it_runs(tmp_path: Path):
    folder = taken(tmp_path / "work", tmp_path / "store")
    (tmp_path / "work" / "queue.lock").write_text("")
    with building_service(tmp_path) as service:
        wait_until(lambda: waits_for(service) is not None)
        assert "another process runs builds in the work folder" in waits_for(service)
        folder.release()
        wait_until(lambda: waits_for(service) is None)


def test_a_folder_that_cannot_be_used_is_told_and_used_once_it_can_be(tmp_path: Path):
    (tmp_path / "work").mkdir()
    (tmp_path / "work" / "queue.lock").mkdir()
    with capture_logs() as lines, building_service(tmp_path) as service:
        wait_until(lambda: waits_for(service) is not None)
        assert "cannot be used: Is a directory" in waits_for(service)
        let_pass(0.3)
        assert len([line for line in lines if line["event"] == "builds wait"]) == 1
        (tmp_path / "work" / "queue.lock").rmdir()
        assert wait_until_ended(service, upload(service))["state"] == "succeeded"


def test_a_service_that_runs_no_builds_says_so_of_those_that_wait(tmp_path: Path):
    with running_service(tmp_path, zenoh=False) as recorder:
        response = upload(recorder)
        assert response.json()["waits_for"] == NOBODY_BUILDS
        assert waits_for(recorder) is None
        with building_service(tmp_path):
            ended = wait_until_ended(recorder, response)
    assert (ended["state"], ended["waits_for"]) == ("succeeded", None)


def test_a_folder_that_cannot_be_written_is_given_back(tmp_path: Path):
    (tmp_path / ".queue.id.part").mkdir()
    with pytest.raises(IsADirectoryError):
        WorkFolder.take(tmp_path, "a")
    (tmp_path / ".queue.id.part").rmdir()
    found = WorkFolder.take(tmp_path, "a")
    assert isinstance(found, WorkFolder)
    found.release()


def test_who_has_the_folder_stands_in_its_lock(tmp_path: Path):
    assert Holder.read(tmp_path / "none") == Holder()
    (tmp_path / "odd").write_text('{"pid": "x"}')
    assert Holder.read(tmp_path / "odd") == Holder()
    first = taken(tmp_path / "work", tmp_path / "a long name of a store")
    first.release()
    second = WorkFolder.take(tmp_path / "work", "b")
    assert isinstance(second, WorkFolder)
    assert WorkFolder.take(tmp_path / "work", "c") == Holder(os.getpid(), "b")
    second.release()

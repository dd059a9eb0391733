"""Embedded queue: several on one store, and in a service that is killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from firstfix.builds.attempts import BuildAttempts
from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_service.builds.process import memory_of_processes_bytes
from firstfix_service.builds.work_folder import WorkFolder
from tests.service.builds_world import building_service, status_of, upload, wait_until_ended
from tests.service.service_world import FAKE_WORKER, running_service
from tests.waiting import wait_until

PATCHED_CLI = Path(__file__).parents[2] / "faults" / "patched_cli.py"


def order(work: Path) -> list[str]:
    path = work / "order.txt"
    return [line.split()[0] for line in path.read_text().splitlines()] if path.exists() else []


@pytest.mark.slow
def test_two_services_on_one_store_share_the_builds(tmp_path: Path):
    with (
        building_service(tmp_path, work_dir=tmp_path / "one", build_lease_s=5) as one,
        building_service(tmp_path, work_dir=tmp_path / "two", build_lease_s=5) as two,
    ):
        long = upload(one, "long", do="until_cancelled")
        wait_until(lambda: status_of(one, long)["state"] == "running")
        responses = [upload(service, f"m{i}") for i, service in enumerate((one, two) * 3)]
        for response in responses:
            assert wait_until_ended(two, response)["state"] == "succeeded"
        assert status_of(two, long)["state"] == "running"
        assert two.http.delete(long.headers["location"]).status_code == 202, "at another service"
        assert wait_until_ended(two, long)["state"] == "cancelled"
    ran = order(tmp_path / "one") + order(tmp_path / "two")
    assert sorted(ran) == sorted(["long", *(f"m{i}" for i in range(6))]), "none twice"


def test_a_build_of_a_dead_service_is_taken_over_when_its_lease_is_out(tmp_path: Path):
    with running_service(tmp_path, zenoh=False) as recorder:
        response = upload(recorder)
        build_id = response.json()["build_id"]
        dead = BuildAttempts(recorder.catalog.store, "dead", lease_s=1.0, max_attempts=3)
        assert dead.claim(build_id, new_status("running", map_id="hall")) is not None
        with building_service(tmp_path, build_lease_s=1.0, work_dir=tmp_path / "other"):
            assert wait_until_ended(recorder, response)["state"] == "succeeded"
        first = recorder.catalog.store.get(f"builds/{build_id}/attempts/000001.end.json")
        assert json.loads(first)["end"] == "stopped", "no process of it had begun"


@pytest.mark.slow
def test_kills_of_the_service_do_not_fail_its_build(tmp_path: Path):
    """Three failures would be one too many: two attempts may fail."""
    environment = {
        **os.environ,
        "FIRSTFIX_STORE": str(tmp_path / "store"),
        "FIRSTFIX_PORT": "0",
        "FIRSTFIX_RUN_BUILDS": "true",
        "FIRSTFIX_BUILD_COMMAND": json.dumps(FAKE_WORKER),
        "FIRSTFIX_WORK_DIR": str(tmp_path / "work"),
        "FIRSTFIX_CACHE_DIR": str(tmp_path / "cache"),
        "CONSTANTS": '{"build_attempts": 2}',
    }
    with running_service(tmp_path, zenoh=False) as recorder:
        response = upload(recorder, do="hang_thrice")
        for times in (1, 2, 3):
            with (tmp_path / "log").open("ab") as log:
                command = [sys.executable, str(PATCHED_CLI), "serve"]
                service = subprocess.Popen(command, env=environment, stdout=log, stderr=log)
            wait_until(lambda times=times: len(order(tmp_path / "work")) == times)
            wait_until(lambda: status_of(recorder, response)["stage"] == "describe")
            service.send_signal(signal.SIGKILL)
            service.wait()
        with building_service(tmp_path, build_attempts=2):
            ended = wait_until_ended(recorder, response)
    assert ended["state"] == "succeeded"


@pytest.mark.slow
def test_restarts_in_good_order_are_not_held_against_a_build(tmp_path: Path):
    response, hung = None, tmp_path / "work" / "hung"
    for _ in range(3):
        hung.unlink(missing_ok=True)  # before a service exists that could run the build
        with building_service(tmp_path, build_attempts=1) as service:
            response = response or upload(service, do="hang_once")
            wait_until(hung.exists)
    with building_service(tmp_path, build_attempts=1) as service:
        assert response is not None
        assert wait_until_ended(service, response)["state"] == "succeeded"


def test_a_second_process_waits_for_the_work_folder(tmp_path: Path):
    folder = WorkFolder.take(tmp_path / "work")
    assert isinstance(folder, WorkFolder)
    assert not isinstance(WorkFolder.take(tmp_path / "work"), WorkFolder)
    with building_service(tmp_path) as service:
        response = upload(service)
        assert status_of(service, response)["state"] == "queued"
        folder.release()
        assert wait_until_ended(service, response)["state"] == "succeeded"
    again = WorkFolder.take(tmp_path / "work")
    assert isinstance(again, WorkFolder)
    assert again.claimant == folder.claimant
    again.release()


def test_a_build_that_takes_too_much_memory_fails_at_once(tmp_path: Path):
    with building_service(tmp_path, build_max_memory_bytes=300 << 20) as service:
        modest, greedy = upload(service, "modest"), upload(service, "greedy", do="allocate_600_mib")
        ended = wait_until_ended(service, greedy)
        assert (ended["state"], ended["error"]["code"]) == ("failed", "build_failed")
        assert f"more memory than the limit of {300 << 20} bytes" in ended["error"]["detail"]
        assert status_of(service, modest)["state"] == "succeeded"
        assert order(tmp_path / "work") == ["modest", "greedy"]


def test_the_memory_of_a_group_is_that_of_all_its_processes():
    allocate = "data = bytearray(100 << 20); data[::4096] = b'x' * len(data[::4096])"
    program = f"""
import subprocess, sys
{allocate}
child = subprocess.Popen([sys.executable, "-c", '''{allocate}
print("ready", flush=True)
input()'''], stdin=sys.stdin)
child.wait()
"""
    process = subprocess.Popen(
        [sys.executable, "-c", program],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        assert 200 << 20 < memory_of_processes_bytes(process.pid) < 300 << 20
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    # The child is nobody's here to wait for: the kernel takes its memory back a moment after the kill.
    wait_until(lambda: memory_of_processes_bytes(process.pid) == 0)


def test_what_is_shared_is_collected_by_the_service(tmp_path: Path):
    store = Store.open(str(tmp_path / "store"))
    store.put(f"stages/{'a' * 64}/stage.json", b"{}")
    old = tmp_path / "store" / "stages" / ("a" * 64) / "stage.json"
    os.utime(old, (time.time() - 8 * 86400,) * 2)
    store.put(f"stages/{'b' * 64}/stage.json", b"{}")
    with building_service(tmp_path, shared_stages_max_bytes=1 << 30):
        wait_until(lambda: Catalog(store).store.list("stages") == [f"stages/{'b' * 64}/stage.json"])

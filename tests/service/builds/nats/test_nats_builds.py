"""Builds over NATS: a recorded build runs once, whichever part dies or does not answer."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from firstfix.catalog.sources import put_source
from firstfix_service.builds.nats.address import NatsAddress
from firstfix_service.builds.nats.builds import NatsBuilds
from firstfix_service.settings import Settings
from tests.certificates import certificates
from tests.nats_server import NEEDS_NATS, nats_server_program
from tests.service.builds_world import status_of, upload
from tests.service.nats_world import LEASE_S, NatsWorld, nats_world
from tests.service.service_world import FAKE_WORKER, Service, running_service
from tests.small_world import COARSE_CONFIG
from tests.tiny_worker import STAGES
from tests.waiting import wait_until

pytestmark = pytest.mark.skipif(nats_server_program() is None, reason=NEEDS_NATS)


@pytest.fixture
def world(tmp_path: Path) -> Iterator[NatsWorld]:
    with nats_world(tmp_path) as running:
        yield running


def hanging(world: NatsWorld, stage: str = "cluster") -> dict[str, Any]:
    """Build options that make a build wait in a stage until ``let_go``."""
    return {"hang_in": stage, "until": str(world.folder / "go")}


def let_go(world: NatsWorld) -> None:
    (world.folder / "go").touch()


def post(service: Service, map_id: str = "hall", **told: Any) -> httpx.Response:
    return upload(service, map_id, do=json.dumps(told))


def submit(world: NatsWorld, *build_ids: str) -> list[bool]:
    async def run() -> list[bool]:
        address = NatsAddress.of(Settings(store=world.store_url, build_queue=world.server.url))
        builds = NatsBuilds(address, lease_s=LEASE_S)
        await builds.connect()
        try:
            await builds.make_streams()
            return [await builds.submit(build_id) for build_id in build_ids]
        finally:
            await builds.close()

    return asyncio.run(run())


def test_a_build_is_in_the_stream_once_however_often_it_is_submitted(world: NatsWorld):
    assert submit(world, "b1", "b2", "b1") == [True, True, False]
    assert submit(world, "b1") == [False]
    assert world.in_stream() == ["b1", "b2"]


def test_a_stream_of_another_release_is_brought_up_to_date(world: NatsWorld):
    async def make_an_old_one() -> None:
        import nats

        client = await nats.connect(world.server.url)
        await client.jetstream().add_stream(
            name="FIRSTFIX_BUILDS", subjects=["firstfix.builds.waiting.*"], retention="workqueue"
        )
        await client.close()

    asyncio.run(make_an_old_one())
    assert submit(world, "b1", "b1") == [True, False]
    assert submit(world, "b1") == [False]


def test_a_posted_map_is_built_by_a_worker_elsewhere(world: NatsWorld):
    with running_service(world.folder, zenoh=False, build_queue=world.server.url) as service:
        response = post(service)
        worker = world.start_worker("w1")
        build_id = response.json()["build_id"]
        status = world.wait_until_ended(build_id)
        assert status["state"] == "succeeded"
        assert status_of(service, response)["version"] == service.catalog.active_version("hall")
        wait_until(lambda: world.in_stream() == [])
        assert worker.made() == list(STAGES)
        wait_until(lambda: 'builds_total{state="succeeded"} 1.0' in health(worker, "metrics").text)
        assert health(worker, "healthz").status_code == health(worker, "readyz").status_code == 200


def health(worker: Any, call: str) -> httpx.Response:
    return httpx.get(f"http://127.0.0.1:{worker.health_port}/{call}")


@pytest.mark.slow
@pytest.mark.parametrize("how", ["kill", "stop"])
def test_a_build_goes_on_at_another_worker_from_the_last_finished_stage(world: NatsWorld, how: str):
    first = world.start_worker("w1")
    build_id = world.record(**hanging(world))
    world.wait_until_in(build_id, "cluster")
    getattr(first, how)()
    if how == "stop":
        assert first.process.returncode == 0
        assert world.state(build_id) == "queued"
    second = world.start_worker("w2")
    world.wait_until_in(build_id, "cluster")
    let_go(world)
    assert world.wait_until_ended(build_id)["state"] == "succeeded"
    assert first.made() == ["read", "mesh", "describe", "cluster"]
    assert second.made() == ["cluster", "index"]
    assert len(world.catalog.log("hall")) == 2, "published and activated once"
    end = json.loads(world.catalog.store.get(f"builds/{build_id}/attempts/000001.end.json"))
    assert end["end"] == "stopped", "its process saw the end of its worker"


@pytest.mark.slow
def test_a_real_build_goes_on_at_another_worker(world: NatsWorld, small_map: Path):
    command = (sys.executable, "-m", "firstfix_builder.worker")
    first = world.start_worker("w1", command=command)
    key = f"maps/yard/sources/{put_source(world.catalog.store, 'yard', small_map)}"
    request = {"map_id": "yard", "source": {"key": key}, "file_name": "yard.ply"}
    world.catalog.builds.put("b1", {**request, "config": {**COARSE_CONFIG, "provisional": False}})
    wait_until(lambda: "fit_engine" in stages_shared(world))
    first.kill()
    world.start_worker("w2", command=command)
    status = world.wait_until_ended("b1")
    assert (status["state"], status["version"]) == ("succeeded", world.catalog.active_version("yard"))
    assert sum(stage["cached"] for stage in world.catalog.builds.stages("b1")) >= 4


def stages_shared(world: NatsWorld) -> set[str]:
    """Names of the stages whose results are in the store, or a part of them."""
    store = world.catalog.store
    records = [key for key in store.list("stages") if key.endswith("/stage.json")]
    return {json.loads(store.get(key))["stage"] for key in records}


def test_stages_are_not_shared_where_that_is_not_wanted(world: NatsWorld):
    world.start_worker_thread(shared_stages_max_bytes=0)
    assert world.wait_until_ended(world.record())["state"] == "succeeded"
    assert world.catalog.store.list("stages") == []


def test_the_build_does_not_outlive_its_worker(world: NatsWorld):
    worker = world.start_worker("w1", command=FAKE_WORKER)
    build_id = world.record(config={"sensor": {"preset": "vlp-16", "name": "hang_thrice"}})
    world.wait_until_in(build_id, "describe")
    pid = int((worker.work / "slot-0" / "order.txt").read_text().split()[-1])
    worker.kill()
    wait_until(lambda: not is_alive(pid))


def is_alive(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.slow
def test_a_build_that_kills_its_worker_time_after_time_is_buried(world: NatsWorld):
    world.start_worker_thread()
    build_id, after = world.record(die_in="describe", stage_s=0.7), world.record()
    status = world.wait_until_ended(build_id)
    assert (status["state"], status["error"]["code"]) == ("failed", "build_attempts_exceeded")
    assert (
        "3 attempts failed without progress; the last one in the stage describe" in status["error"]["detail"]
    )
    assert world.wait_until_ended(after)["state"] == "succeeded"
    wait_until(lambda: world.in_stream() == [])
    assert world.in_stream("FIRSTFIX_DEAD_BUILDS") == [build_id]


@pytest.mark.slow
def test_stops_in_good_order_are_not_held_against_a_build(world: NatsWorld):
    build_id = world.record(**hanging(world))
    for _ in range(2):
        world.start_worker_thread(build_attempts=1)
        world.wait_until_in(build_id, "cluster")
        world.stop_worker_threads()
        assert world.state(build_id) == "queued"
    let_go(world)
    world.start_worker_thread(build_attempts=1)
    assert world.wait_until_ended(build_id)["state"] == "succeeded"


def test_a_waiting_and_a_running_build_are_cancelled(world: NatsWorld):
    with running_service(world.folder, zenoh=False, build_queue=world.server.url) as service:
        world.start_worker_thread()
        running, waiting = post(service, **hanging(world)), post(service, "office")
        world.wait_until_in(running.json()["build_id"], "cluster")
        cancelled = service.http.delete(waiting.headers["location"])
        assert (cancelled.status_code, cancelled.json()["state"]) == (202, "cancelled")
        assert service.http.delete(running.headers["location"]).json()["state"] == "running"
        assert world.wait_until_ended(running.json()["build_id"])["state"] == "cancelled"
        wait_until(lambda: world.in_stream() == [])
        assert service.http.delete(running.headers["location"]).json()["code"] == "conflict"
    assert world.catalog.map_ids() == []


@pytest.mark.slow
def test_a_map_that_is_posted_while_nats_is_away_is_built_later(world: NatsWorld):
    with running_service(world.folder, zenoh=False, build_queue=world.server.url) as service:
        first = post(service, "before")
        wait_until(lambda: world.in_stream() == [first.json()["build_id"]])
        world.server.stop()
        response = post(service, "while")
        assert response.status_code == 202
        assert status_of(service, response)["state"] == "queued"
        world.server.start()
        world.start_worker_thread()
        for posted in (first, response):
            assert world.wait_until_ended(posted.json()["build_id"])["state"] == "succeeded"


def test_a_service_starts_without_nats(tmp_path: Path):
    with nats_world(tmp_path) as world:
        world.server.stop()
        with running_service(world.folder, zenoh=False, build_queue=world.server.url) as service:
            response = post(service)
            assert response.status_code == 202
            world.server.start()
            world.start_worker_thread()
            assert world.wait_until_ended(response.json()["build_id"])["state"] == "succeeded"


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_a_build_outlasts_a_restart_of_nats(world: NatsWorld, number: signal.Signals):
    world.start_worker_thread()
    build_id = world.record(**hanging(world))
    world.wait_until_in(build_id, "cluster")
    world.server.stop(number)
    let_go(world)
    assert world.wait_until_ended(build_id)["state"] == "succeeded", "the worker goes on without it"
    after = world.record()
    world.server.start()
    assert world.wait_until_ended(after)["state"] == "succeeded"
    wait_until(lambda: world.in_stream() == [])
    assert len(world.catalog.store.list(f"builds/{build_id}/attempts")) == 2, "one attempt, and its end"


def test_a_stream_that_was_lost_is_made_again_from_the_store(world: NatsWorld):
    async def lose_it() -> None:
        import nats

        client = await nats.connect(world.server.url)
        await client.jetstream().delete_stream("FIRSTFIX_BUILDS")
        await client.close()

    build_id = world.record()
    submit(world, build_id)
    asyncio.run(lose_it())
    world.start_worker_thread()
    assert world.wait_until_ended(build_id)["state"] == "succeeded"


@pytest.mark.slow
def test_two_workers_build_two_maps_at_a_time_and_none_twice(world: NatsWorld):
    workers = [world.start_worker("w1"), world.start_worker("w2")]
    builds = [world.record(f"m{i}", stage_s=0.2) for i in range(4)]
    for build_id in builds:
        assert world.wait_until_ended(build_id)["state"] == "succeeded"
    made = [worker.made() for worker in workers]
    assert len(made[0]) + len(made[1]) == len(builds) * len(STAGES)
    assert min(map(len, made)) > 0, "both had some"


@pytest.mark.slow
def test_one_worker_may_run_several(world: NatsWorld):
    world.start_worker_thread(concurrency=2)
    builds = [world.record(f"m{i}", **hanging(world)) for i in range(2)]
    for build_id in builds:
        world.wait_until_in(build_id, "cluster")
    let_go(world)
    for build_id in builds:
        assert world.wait_until_ended(build_id)["state"] == "succeeded"


def test_what_is_no_build_does_not_hold_up_the_others(world: NatsWorld):
    submit(world, "nosuchbuild")
    world.start_worker_thread()
    assert world.wait_until_ended(world.record())["state"] == "succeeded"
    wait_until(lambda: world.in_stream() == [])
    assert world.in_stream("FIRSTFIX_DEAD_BUILDS") == ["nosuchbuild"]


def test_deployments_that_share_a_server_do_not_see_each_others_builds(world: NatsWorld):
    world.start_worker_thread(build_queue=f"{world.server.url}/other")
    assert world.wait_until_ended(world.record())["state"] == "succeeded"
    with pytest.raises(Exception, match="stream not found"):
        world.in_stream("FIRSTFIX_BUILDS")
    wait_until(lambda: world.in_stream("OTHER_BUILDS") == [])


def test_the_user_comes_from_a_file_and_no_build_gets_it(tmp_path: Path):
    (tmp_path / "login").write_text("builder:s3cret\n")
    config = "authorization { user: builder, password: s3cret }"
    with nats_world(tmp_path / "world", config=config) as world:
        command = ("sh", "-c", "env")  # shows the environment of a build
        world.start_worker("w1", command=command, FIRSTFIX_NATS_CREDENTIALS=str(tmp_path / "login"))
        assert world.wait_until_ended(world.record())["state"] == "failed"
        (log,) = (world.folder / "w1").rglob("*.log")
        assert "FIRSTFIX_BUILD_QUEUE" in log.read_text()
        assert "FIRSTFIX_NATS" not in log.read_text()
        assert "s3cret" not in (world.folder / "w1.log").read_text()


def test_both_sides_show_their_certificates(tmp_path: Path):
    ca, server, client = certificates(tmp_path)
    config = f"""tls {{ cert_file: "{server}", key_file: "{server}", ca_file: "{ca}", verify: true }}"""
    with nats_world(tmp_path / "world", config=config) as world:
        url = world.server.url.replace("nats://", "tls://")
        world.start_worker_thread(build_queue=url, nats_ca=ca, nats_certificate=client)
        assert world.wait_until_ended(world.record())["state"] == "succeeded"

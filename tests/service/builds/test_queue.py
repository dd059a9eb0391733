"""The queue of builds: owners take turns, services share it, and a damaged record holds up no other build."""

from __future__ import annotations

import asyncio
import json
import os
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.builds.attempts import BuildAttempts
from firstfix.builds.records import FINAL_STATES, new_status
from firstfix.catalog.catalog import Catalog
from firstfix.store.json_record import record_json
from firstfix.store.store import Store
from firstfix_service.builds.nats.builds import MAX_AHEAD
from firstfix_service.builds.queue import FairOrder, UnfinishedBuild, UnfinishedBuilds
from firstfix_service.builds.work_folder import WorkFolder
from firstfix_service.telemetry.metrics import Metrics
from tests.service.builds_world import building_service, order, status_of, upload, wait_until_ended
from tests.service.callers_world import Caller, callers
from tests.service.nats_world import nats_world
from tests.service.service_world import Service, serving
from tests.waiting import wait_until


def builds(owners: str) -> list[UnfinishedBuild]:
    return [UnfinishedBuild(f"{owner}{age}", owner) for age, owner in enumerate(owners)]


def ids(found: list[UnfinishedBuild]) -> list[str]:
    return [build.build_id for build in found]


def test_owners_take_turns():
    assert ids(FairOrder().sort(builds("aaaabbc"))) == ["a0", "b4", "c6", "a1", "b5", "a2", "a3"]


def test_an_owner_comes_last_after_its_turn():
    order = FairOrder()
    order.had_turn("a")
    order.had_turn("b")
    assert ids(order.sort(builds("abcd"))) == ["c2", "d3", "a0", "b1"]
    order.had_turn("a")
    assert ids(order.sort(builds("ab"))) == ["b1", "a0"]


@given(st.text("abcd", min_size=1, max_size=40))
def test_an_owner_waits_for_one_build_of_each_other_at_most(owners: str):
    """Between two turns of one owner, every other owner has a turn."""
    waiting, order = builds(owners), FairOrder()
    ran = []
    while waiting:
        following = order.sort(waiting)[0]
        order.had_turn(following.owner)
        ran.append(following)
        waiting.remove(following)
    for owner in set(owners):
        mine = [place for place, build in enumerate(ran) if build.owner == owner]
        assert [ran[place] for place in mine] == [build for build in builds(owners) if build.owner == owner]
        for before, after in zip([-1, *mine], mine, strict=False):
            between = [build.owner for build in ran[before + 1 : after]]
            assert len(between) == len(set(between))


def test_a_flood_of_builds_does_not_hold_up_another_caller(tmp_path: Path):
    with callers(tmp_path) as these:
        for number in range(4):
            these.a.post_map(f"a{number}")
        last = [these.b.post_map(f"b{number}").json()["build_id"] for number in range(2)]
        catalog = these.service.catalog
        with building_service(tmp_path, work_dir=tmp_path / "other"):
            for build_id in last:
                wait_until(lambda: catalog.builds.status(build_id)["state"] in FINAL_STATES)  # noqa: B023
    assert order(tmp_path / "other")[:4] == ["a0", "b0", "a1", "b1"]


def test_a_flood_of_builds_leaves_room_in_the_stream(tmp_path: Path):
    def post(caller: Caller, name: str) -> str:
        return str(caller.post_map(name).json()["build_id"])

    with nats_world(tmp_path) as world, callers(tmp_path, build_queue=world.server.url) as these:
        flood = [post(these.a, f"a{number}") for number in range(MAX_AHEAD + 4)]
        wait_until(lambda: len(world.in_stream()) == MAX_AHEAD)
        other = post(these.b, "b")
        assert world.in_stream() == flood[:MAX_AHEAD]
        # one is done: the build of the other caller comes next
        these.a.call("DELETE", f"/builds/{flood[0]}")
        taken = take_one(world.server.url)
        assert taken == flood[0]
        wait_until(lambda: other in world.in_stream())
        assert world.in_stream() == sorted([*flood[1:MAX_AHEAD], other])


def take_one(url: str) -> str:
    """Takes and acknowledges a message, as a build worker does with a cancelled build."""

    async def take() -> str:
        import nats

        client = await nats.connect(url)
        try:
            waiting = await client.jetstream().pull_subscribe_bind("workers", "FIRSTFIX_BUILDS")
            (message,) = await waiting.fetch(1, timeout=20)
            await message.ack_sync()
            return message.data.decode()
        finally:
            await client.close()

    return asyncio.run(take())


BROKEN = [b"", b'{"map_id": "ha', b"[]", b'{"state": 3, "map_id": []}', b'{"a":' * 50_000]


def waiting_builds(store: Store) -> Catalog:
    catalog = Catalog(store)
    for build_id in ("b1", "b2", "b3"):
        catalog.builds.put(build_id, {"map_id": "hall"})
    return catalog


@pytest.mark.parametrize("record", BROKEN)
@pytest.mark.parametrize("name", ["request.json", "status.json"])
def test_the_queue_skips_damaged_builds(record: bytes, name: str):
    catalog, metrics = waiting_builds(Store.open("memory://")), Metrics()
    catalog.store.put(f"builds/b2/{name}", record)
    queue = UnfinishedBuilds(catalog, metrics)
    assert [build.build_id for build in queue.find()] == ["b1", "b3"]
    assert metrics.registry.get_sample_value("firstfix_builds_waiting") == 2
    catalog.store.delete(f"builds/b2/{name}")
    catalog.store.put("builds/b2/request.json", record_json({"map_id": "hall"}))
    assert [build.build_id for build in queue.find()] == ["b1", "b2", "b3"], "once it is mended"


@pytest.fixture
def service_with_damage(service: Service) -> Service:
    catalog = waiting_builds(service.catalog.store)
    catalog.builds.set_status("b3", new_status("succeeded", map_id="hall", version="a" * 64))
    service.catalog.store.put("builds/b2/status.json", b"")
    return service


def test_a_damaged_build_is_listed_as_unreadable(service_with_damage: Service):
    http = service_with_damage.http
    listed = {build["build_id"]: build for build in http.get("/builds").json()["builds"]}
    assert {name: build["state"] for name, build in listed.items()} == {
        "b1": "queued",
        "b2": "unreadable",
        "b3": "succeeded",
    }
    assert listed["b2"]["map_id"] == "hall"
    assert listed["b2"]["error"]["code"] == "unreadable_record"
    (found,) = http.get("/builds?state=unreadable").json()["builds"]
    assert found == http.get("/builds/b2").json() == listed["b2"]
    assert service_with_damage.value("firstfix_unreadable_records_total", kind="build_status") == 1
    assert http.post("/collect-garbage").status_code == 200


def test_a_damaged_build_cannot_be_cancelled(service_with_damage: Service):
    refused = service_with_damage.http.delete("/builds/b2")
    assert (refused.status_code, refused.json()["code"]) == (502, "unreadable_record")


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


@serving(zenoh=False, maps={})
def test_a_build_of_a_dead_service_is_taken_over_after_its_lease(service: Service, tmp_path: Path):
    response = upload(service)
    build_id = response.json()["build_id"]
    dead = BuildAttempts(service.catalog.store, "dead", lease_s=1.0, max_attempts=3)
    assert dead.claim(build_id, new_status("running", map_id="hall")) is not None
    with building_service(tmp_path, build_lease_s=1.0, work_dir=tmp_path / "other"):
        assert wait_until_ended(service, response)["state"] == "succeeded"
    first = service.catalog.store.get(f"builds/{build_id}/attempts/000001.end.json")
    assert json.loads(first)["end"] == "stopped", "no process of it had begun"


@pytest.mark.slow
def test_orderly_restarts_do_not_count_as_failures_of_a_build(tmp_path: Path):
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


def test_the_service_collects_old_shared_stages(tmp_path: Path):
    store = Store.open(str(tmp_path / "store"))
    store.put(f"stages/{'a' * 64}/stage.json", b"{}")
    old = tmp_path / "store" / "stages" / ("a" * 64) / "stage.json"
    os.utime(old, (time.time() - 8 * 86400,) * 2)
    store.put(f"stages/{'b' * 64}/stage.json", b"{}")
    with building_service(tmp_path, shared_stages_max_bytes=1 << 30):
        wait_until(lambda: Catalog(store).store.list("stages") == [f"stages/{'b' * 64}/stage.json"])

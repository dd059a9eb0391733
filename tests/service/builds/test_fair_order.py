"""Fair order of builds: owners take turns."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.builds.records import FINAL_STATES
from firstfix_service.builds.nats.builds import MAX_AHEAD
from firstfix_service.builds.queue import FairOrder, UnfinishedBuild
from tests.nats_server import NEEDS_NATS, nats_server_program
from tests.service.builds_world import building_service
from tests.service.callers_world import Caller, callers
from tests.service.nats_world import nats_world
from tests.waiting import wait_until


def builds(owners: str) -> list[UnfinishedBuild]:
    return [UnfinishedBuild(f"{owner}{age}", owner) for age, owner in enumerate(owners)]


def ids(found: list[UnfinishedBuild]) -> list[str]:
    return [build.build_id for build in found]


def test_callers_take_turns():
    assert ids(FairOrder().sort(builds("aaaabbc"))) == ["a0", "b4", "c6", "a1", "b5", "a2", "a3"]


def test_who_had_a_turn_is_last_of_the_round():
    order = FairOrder()
    order.had_turn("a")
    order.had_turn("b")
    assert ids(order.sort(builds("abcd"))) == ["c2", "d3", "a0", "b1"]
    order.had_turn("a")
    assert ids(order.sort(builds("ab"))) == ["b1", "a0"]


@given(st.text("abcd", min_size=1, max_size=40))
def test_a_caller_waits_for_one_build_of_each_other_at_most(owners: str):
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
        lines = (tmp_path / "other" / "order.txt").read_text().splitlines()
    assert [line.split()[0] for line in lines][:4] == ["a0", "b0", "a1", "b1"]


@pytest.mark.skipif(nats_server_program() is None, reason=NEEDS_NATS)
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

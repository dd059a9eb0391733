"""Replicas that share the maps.

Over the router of deploy/zenoh with its rules, one replica is killed and started again while robots ask. The
view of a single replica is tested over sessions on loopback.
"""

from __future__ import annotations

import asyncio
import json
import random
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import zenoh

from firstfix.answer.localization import Verdict
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.rendezvous import rendezvous_order
from firstfix.store.store import Store
from firstfix_client import RetryPolicy, ZenohClient
from firstfix_service import server
from firstfix_service.settings import Settings
from firstfix_service.zenoh_api.config import client_config, session_config
from firstfix_service.zenoh_api.replicas import ZenohReplicas
from tests.service.service_world import client_session, free_port, publish, running_service
from tests.service.zenoh_world import ZenohWorld
from tests.waiting import LIMIT_S, let_pass, wait_until, wait_until_async

pytestmark = pytest.mark.slow

SCAN = np.ones((50, 3), np.float32)
MAPS = [f"map-{k:02}" for k in range(12)]
COPIES = 2


def holders(names: list[str]) -> dict[str, set[str]]:
    return {map_id: set(rendezvous_order(map_id, names)[:COPIES]) for map_id in MAPS}


class Fleet:
    """Robots that query one map after the other until they are stopped."""

    def __init__(self, config: Path, robots: int) -> None:
        self.failures: list[str] = []
        self.answers = 0
        self._stop = threading.Event()
        self._threads = [threading.Thread(target=self._run, args=(config, k)) for k in range(robots)]

    def __enter__(self) -> Fleet:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _run(self, config: Path, number: int) -> None:
        turn = random.Random(number)
        with ZenohClient(config=config, timeout_s=15.0, retry=RetryPolicy(first_wait_s=0.05)) as robot:
            while not self._stop.is_set():
                map_id = turn.choice(MAPS)
                try:
                    answer = robot.localize(SCAN, map_id=map_id)
                    assert (answer.verdict, answer.map_id) == (Verdict.LOCALIZED, map_id)
                except Exception as error:
                    self.failures.append(repr(error))
                self.answers += 1


def test_each_map_has_its_holders_and_another_takes_over_for_one_that_dies(tmp_path: Path):
    store = str(tmp_path / "store")
    catalog = Catalog(Store.open(store))
    for k, map_id in enumerate(MAPS):
        publish(catalog, map_id, str(k), tmp_path / "made")
    world = ZenohWorld(tmp_path / "zenoh")
    names = ["r1", "r2", "r3"]
    with ExitStack() as stack:
        stack.enter_context(world.router())
        settings = {"holders": COPIES, "poll_interval_s": 1}
        running = {name: stack.enter_context(world.replica(name, store, **settings)) for name in names}
        robot = stack.enter_context(world.session("robot"))
        operator = stack.enter_context(world.session("operator"))

        def shown() -> dict[str, set[str]]:
            return {map_id: world.replicas(robot, map_id) for map_id in MAPS}

        def described() -> dict[str, dict[str, Any]]:
            replies = operator.get("firstfix/@replicas/*", timeout=5)
            found = [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]
            return {one["replica"]: one for one in found}

        def is_shared_by(*alive: str) -> bool:
            wanted = holders(list(alive))
            held = {name: sum(name in some for some in wanted.values()) for name in alive}
            seen = described()
            return shown() == wanted and {name: one["holding"] for name, one in seen.items()} == {
                name: {"copies": 2, "replicas": len(alive), "maps": held[name], "loaded": held[name]}
                for name in alive
            }

        wait_until(lambda: is_shared_by(*names))
        with ZenohClient(config=world.config_of("operator")) as client:
            held = {one.replica: one.held for one in client.replicas()}
        assert held == {name: sum(name in some for some in holders(names).values()) for name in names}
        with Fleet(world.config_of("robot"), 3) as fleet:
            wait_until(lambda: fleet.answers > 30)
            running["r2"].send_signal(signal.SIGKILL)
            wait_until(lambda: is_shared_by("r1", "r3"))
            before = fleet.answers
            stack.enter_context(world.replica("r2", store, **settings))
            wait_until(lambda: is_shared_by(*names))
            wait_until(lambda: fleet.answers > before + 30)
        assert fleet.failures == []


@pytest.fixture
def router() -> Iterator[str]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    config = zenoh.Config()
    config.insert_json5("mode", '"router"')
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    session = zenoh.open(config)
    yield endpoint
    session.close()


class Seen:
    """Records the calls of a watch, and can hold them up."""

    def __init__(self) -> None:
        self.views: list[frozenset[str]] = []
        self.superseded: Callable[[], bool] = lambda: False
        self.gate = threading.Event()
        self.gate.set()

    def __call__(self, names: frozenset[str], superseded: Callable[[], bool]) -> None:
        self.views.append(names)
        self.superseded = superseded
        assert self.gate.wait(LIMIT_S)


@pytest.fixture
def watch(router: str) -> Iterator[Callable[..., tuple[ZenohReplicas, Seen]]]:
    with ExitStack() as stack:

        def make(name: str, settled_s: float = 0.2) -> tuple[ZenohReplicas, Seen]:
            session, seen = client_session(router), Seen()
            made = ZenohReplicas(session, name, seen, settled_s=settled_s)
            stack.callback(session.close)
            stack.callback(made.close)
            stack.callback(seen.gate.set)
            return made, seen

        yield make


def test_a_replica_counts_from_when_it_joins_until_it_closes(watch):
    first, seen = watch("r1")
    assert first.start() == {"r1"}
    first.join()
    second, _ = watch("r2")
    wait_until(lambda: second.names == {"r2"})
    assert second.start() == {"r1", "r2"}
    let_pass(0.5)
    assert seen.views == [], "it has not joined"
    second.join()
    second.join()
    wait_until(lambda: seen.views == [{"r1", "r2"}])
    second.close()
    wait_until(lambda: seen.views == [{"r1", "r2"}, {"r1"}])


def test_a_replica_that_is_about_to_stop_leaves_its_maps_and_goes_on_answering(tmp_path, monkeypatch):
    """It went on for 4 s, in which a busy machine may not come to ask. Now it goes on until it was asked."""
    asked = threading.Event()

    async def until_asked(_: float) -> None:
        await wait_until_async(asked.is_set)

    monkeypatch.setattr(server, "asyncio", SimpleNamespace(**{**vars(asyncio), "sleep": until_asked}))
    publish(Catalog(Store.open(str(tmp_path / "store"))), "hall", "1", tmp_path / "made")
    with running_service(tmp_path, holders=1, drain_s=LIMIT_S) as service, ExitStack() as stack:
        stack.callback(asked.set)

        def shows(key: str) -> bool:
            return bool(list(service.session.liveliness().get(key, timeout=5)))

        wait_until(lambda: shows("firstfix/@replicas/r1") and shows("firstfix/hall/localize/r1"))
        service.stop()
        wait_until(lambda: not shows("firstfix/@replicas/r1"))
        assert shows("firstfix/hall/localize/r1")
        assert service.ask_zenoh(key="firstfix/hall/localize/r1").ok


def test_short_changes_of_replicas_are_ignored(watch, router):
    first, seen = watch("r1", settled_s=5.0)
    first.start()
    session = client_session(router)
    for _ in range(5):
        token = session.liveliness().declare_token("firstfix/@replicas/r2")
        let_pass(0.05)
        token.undeclare()
        let_pass(0.05)
    kept = session.liveliness().declare_token("firstfix/@replicas/r3")
    wait_until(lambda: seen.views)
    assert seen.views == [{"r1", "r3"}]
    kept.undeclare()
    session.close()


def test_a_change_during_a_takeover_supersedes_it(watch, router):
    first, seen = watch("r1")
    first.start()
    session = client_session(router)
    seen.gate.clear()
    token = session.liveliness().declare_token("firstfix/@replicas/r2")
    wait_until(lambda: seen.views == [{"r1", "r2"}])
    assert not seen.superseded()
    other = session.liveliness().declare_token("firstfix/@replicas/r3")
    wait_until(seen.superseded)
    other.undeclare()
    wait_until(lambda: first.names == {"r1", "r2"})
    seen.gate.set()
    wait_until(lambda: len(seen.views) == 2)
    assert seen.views[1] == {"r1", "r2"}, "told again, as it was not seen to"
    token.undeclare()
    session.close()


def test_a_replica_that_is_cut_off_keeps_the_others_in_its_view(tmp_path: Path):
    world = ZenohWorld(tmp_path / "zenoh")
    settings = Settings(store="memory://", zenoh_config=world.folder / "replica.json5")
    seen, both = Seen(), {"r1", "r2"}
    with ExitStack() as stack:
        watches = []
        for name, told in (("r1", seen), ("r2", Seen())):
            session = zenoh.open(session_config(settings))
            stack.callback(session.close)
            watches.append(ZenohReplicas(session, name, told, client_config(settings), settled_s=0.2))
            stack.callback(watches[-1].close)
            assert watches[-1].start() == {name}, "there is no router yet"
            watches[-1].join()
        with world.router():
            wait_until(lambda: seen.views and seen.views[-1] == both)
        views = len(seen.views)
        let_pass(1.5)
        assert len(seen.views) == views, "it is alone, and knows why"
        with world.router():
            wait_until(lambda: watches[0].names == watches[1].names == both)
            watches[1].close()
            wait_until(lambda: seen.views[-1] == {"r1"})


def test_the_watch_is_a_client_of_the_configured_peers():
    alone = Settings(store="memory://", zenoh=True)
    assert client_config(alone) is None
    connects = Settings(store="memory://", zenoh=True, zenoh_connect=("tcp/router:7447",))
    config = client_config(connects)
    assert config.get_json("mode") == '"client"'
    assert json.loads(config.get_json("connect/endpoints")) == ["tcp/router:7447"]
    assert json.loads(config.get_json("listen/endpoints")) == []


def test_a_defect_in_taking_over_does_not_end_the_watch(watch, router, monkeypatch):
    first, seen = watch("r1")
    monkeypatch.setattr(first, "_changed", lambda names, superseded: (seen(names, superseded), 1 / 0))
    first.start()
    session = client_session(router)
    tokens = []
    for name in ("r2", "r3"):
        tokens.append(session.liveliness().declare_token(f"firstfix/@replicas/{name}"))
        wait_until(lambda name=name: seen.views and name in seen.views[-1])
    session.close()


def test_named_replicas_need_no_zenoh(tmp_path: Path):
    catalog = Catalog(Store.open(str(tmp_path / "store")))
    for k, map_id in enumerate(MAPS):
        publish(catalog, map_id, str(k), tmp_path / "made")
    mine = {map_id for map_id in MAPS if rendezvous_order(map_id, ["r1", "r2"])[0] == "r1"}
    named = {"holders": 1, "replica_names": ("r1", "r2"), "zenoh": False}
    with running_service(tmp_path, **named) as service:
        wait_until(lambda: service.http.get("/readyz").is_success)
        holding = service.http.get("/readyz").json()["holding"]
        assert holding == {"copies": 1, "replicas": 2, "maps": len(mine), "loaded": len(mine)}
        assert {MAPS[int(label)] for label in service.behaviour.loads} == mine
        shown = [
            service.value(f"firstfix_{name}")
            for name in ("maps_held", "maps_held_loaded", "holding_replicas")
        ]
        assert shown == [len(mine), len(mine), 2]
        (foreign, *_) = sorted(set(MAPS) - mine)
        assert service.ask_http(map_id=foreign).x == MAPS.index(foreign), "any map is answered"

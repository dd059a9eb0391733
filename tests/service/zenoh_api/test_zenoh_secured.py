"""The example files of deploy/zenoh: TLS, passwords and access rules of a router; replicas die and return."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import zenoh

from firstfix.answer.localization import Verdict
from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_client import RetryPolicy, ServiceUnreachable, ZenohClient
from tests.service.service_world import SCAN_BODY, XYZ, publish
from tests.service.zenoh_world import ZenohWorld, make_certificates
from tests.waiting import LIMIT_S, let_pass, wait_until

SCAN = np.ones((50, 3), np.float32)
PATIENT = RetryPolicy(attempts=200, first_wait_s=0.05, max_wait_s=0.2)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ZenohWorld]:
    """A router and a replica "r0" with the maps hall and attic."""
    folder = tmp_path_factory.mktemp("secured")
    catalog = Catalog(Store.open(str(folder / "store")))
    for map_id in ("hall", "attic"):
        publish(catalog, map_id, "1", folder / "made")
    world = ZenohWorld(folder / "zenoh")
    with world.router(), world.replica("r0", str(folder / "store")):
        with world.session("robot") as session:
            wait_until(lambda: "r0" in world.replicas(session, "attic"))
        yield world


def client(world: ZenohWorld, user: str = "robot", timeout_s: float = 10.0) -> ZenohClient:
    return ZenohClient(config=world.config_of(user), timeout_s=timeout_s, retry=PATIENT)


def answered(session: zenoh.Session, key: str) -> bool:
    replies = list(session.get(key, payload=SCAN_BODY, encoding=XYZ, timeout=LIMIT_S))
    return any(reply.ok is not None for reply in replies)


def test_a_robot_may_ask_every_map(world: ZenohWorld):
    with client(world) as robot:
        for map_id in ("hall", "attic"):
            assert robot.localize(SCAN, map_id=map_id).verdict is Verdict.LOCALIZED
        assert [one.map_id for one in robot.maps()] == ["attic", "hall"]
        with robot.watch_versions() as watch:
            assert {next(watch).map_id, next(watch).map_id} == {"attic", "hall"}


def test_a_guest_may_ask_one_map_alone(world: ZenohWorld):
    with client(world, "guest") as guest:
        assert guest.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
    with world.session("guest") as session:
        assert answered(session, "firstfix/hall/localize")
        assert answered(session, "firstfix/hall/version")
        for key in (
            "firstfix/attic/localize",
            "firstfix/attic/localize/r0",
            "firstfix/*/localize",
            "firstfix/@any/localize",
            "firstfix/@any/localize?map=attic",
            "firstfix/attic/version",
            "firstfix/*/version",
            "firstfix/maps",
            "firstfix/@replicas/r0",
            "**",
        ):
            assert not answered(session, key), key
        assert world.replicas(session, "attic") == set()


def test_an_operator_sees_replicas_and_is_not_answered(world: ZenohWorld):
    with client(world, "operator") as operator:
        assert [one.replica for one in operator.replicas()] == ["r0"]
    with world.session("operator") as session:
        assert not answered(session, "firstfix/hall/localize")


def test_only_replicas_publish_versions(world: ZenohWorld):
    heard = []
    with world.session("robot") as listener, world.session("robot") as liar, world.session("replica") as real:
        listener.declare_subscriber("firstfix/*/version", lambda s: heard.append(s.payload.to_bytes()))
        assert answered(listener, "firstfix/hall/version")  # the declaration has arrived before it
        liar.put("firstfix/hall/version", b"a lie")
        assert answered(liar, "firstfix/hall/version")
        real.put("firstfix/hall/version", b"the truth")
        wait_until(lambda: heard)
    assert heard == [b"the truth"]


def test_only_replicas_publish_and_read_answers(world: ZenohWorld):
    heard: list[bytes] = []
    overheard: list[bytes] = []
    key = "firstfix/@answers/*"
    with (
        world.session("replica") as watcher,
        world.session("robot") as listener,
        world.session("robot") as liar,
        client(world) as asking,
    ):
        watcher.declare_subscriber(key, lambda s: heard.append(s.payload.to_bytes()))
        listener.declare_subscriber(key, lambda s: overheard.append(s.payload.to_bytes()))
        assert answered(listener, "firstfix/hall/localize")  # the declaration has arrived before it

        def told(count: int) -> bool:
            assert asking.localize(SCAN, map_id="attic").verdict is Verdict.LOCALIZED
            return len(heard) >= count

        wait_until(lambda: told(1))
        liar.put("firstfix/@answers/r0", b"a lie")
        assert answered(liar, "firstfix/hall/localize")
        told_so_far = len(heard)
        wait_until(lambda: told(told_so_far + 2))
    assert b"a lie" not in heard
    assert overheard == []


def test_a_guest_cannot_pose_as_a_replica(world: ZenohWorld):
    asked = []
    with world.session("guest") as session:
        session.declare_queryable("firstfix/hall/localize", asked.append, complete=True)
        session.liveliness().declare_token("firstfix/hall/localize/evil")
        with world.session("robot") as robot:
            assert "evil" not in world.replicas(robot, "hall")
            assert answered(robot, "firstfix/hall/localize")
    assert asked == []


@pytest.mark.parametrize(("user", "password"), [("robot", "wrong"), ("stranger", None)])
def test_a_wrong_password_does_not_get_in(world: ZenohWorld, user: str, password: str | None):
    with pytest.raises(ServiceUnreachable):
        ZenohClient(config=world.config_of(user, password), timeout_s=5)


def test_a_router_of_another_authority_is_not_trusted(world: ZenohWorld, tmp_path: Path):
    make_certificates(tmp_path)
    config = tmp_path / "robot.json5"
    config.write_text((world.folder / "robot.json5").read_text().replace(str(world.folder), str(tmp_path)))
    with pytest.raises(ServiceUnreachable):
        ZenohClient(config=config, timeout_s=5)


@pytest.fixture
def own_world(tmp_path: Path) -> Iterator[ZenohWorld]:
    """Files and a store for one test that damages them."""
    publish(Catalog(Store.open(str(tmp_path / "store"))), "hall", "1", tmp_path / "made")
    return ZenohWorld(tmp_path / "zenoh")


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP])
def test_another_replica_answers_for_a_dead_or_hanging_one(own_world: ZenohWorld, how: signal.Signals):
    store = str(own_world.folder.parent / "store")
    with (
        own_world.router(),
        own_world.replica("r1", store, fake_seconds=0.3) as victim,
        own_world.replica("r2", store, fake_seconds=0.3),
        client(own_world, timeout_s=20.0) as robot,
        ThreadPoolExecutor(4) as threads,
    ):
        with own_world.session("robot") as session:
            wait_until(lambda: own_world.replicas(session, "hall") == {"r1", "r2"})
        done = [threads.submit(robot.localize, SCAN, map_id="hall") for _ in range(4)]
        for answer in done:
            assert answer.result().verdict is Verdict.LOCALIZED
        running = [threads.submit(robot.localize, SCAN, map_id="hall") for _ in range(8)]
        let_pass(0.1)  # they are under way, with either; whenever it comes, no answer is lost
        victim.send_signal(how)
        for answer in running:
            assert answer.result().verdict is Verdict.LOCALIZED


def test_all_reconnect_to_a_restarted_router(own_world: ZenohWorld):
    store = str(own_world.folder.parent / "store")
    with (
        own_world.router() as router,
        own_world.replica("r1", store),
        client(own_world, timeout_s=60.0) as robot,
        robot.watch_versions(look_every_s=0.5) as watch,
    ):
        first = next(watch).version
        assert robot.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
        router.kill()
        router.wait()
        second = publish(Catalog(Store.open(store)), "hall", "2", own_world.folder / "made")
        with own_world.router():
            assert robot.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED
            assert next(watch).version == second != first
            with own_world.session("robot") as session:
                wait_until(lambda: own_world.replicas(session, "hall") == {"r1"})


def test_a_replica_waits_for_its_router(own_world: ZenohWorld):
    store, log = str(own_world.folder.parent / "store"), own_world.folder / "r1.log"
    with own_world.replica("r1", store, has_router=False):
        wait_until(lambda: "answering over zenoh" in log.read_text())
        with own_world.router(), client(own_world, timeout_s=60.0) as robot:
            assert robot.localize(SCAN, map_id="hall").verdict is Verdict.LOCALIZED

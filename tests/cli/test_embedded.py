"""The localizer in the gateway's process: the service's answers, updates behind its back, no network."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Localization, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.catalog import Catalog
from firstfix.catalog.versions import cache as version_cache
from firstfix.catalog.versions.last_served import LastServed
from firstfix.errors import FirstfixError, InvalidOption, NotFound, StoreUnavailable, VersionError
from firstfix.formats.point_cloud import SCAN_LIMITS
from firstfix.ros.media_types import POINT_CLOUD2
from firstfix.ros.point_cloud2 import decode_point_cloud2
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix.transform import from_quaternion, pose_error
from firstfix_cli import embedded
from firstfix_cli.answerer import answerer
from firstfix_cli.embedded import EmbeddedLocalizer
from firstfix_cli.local_service import local_service
from firstfix_client import Client
from tests.ros_samples import cdr, cloud_of_points
from tests.waiting import LIMIT_S, wait_until

OPTIONS = LocalizeOptions()
OUTSIDE = ("exists", "folders", "get", "list", "scan", "sha256", "size", "download", "names")


class RemoteStore(Store):
    """A store behind a network that can be cut. It counts the requests."""

    is_cut = False
    requests = 0

    def __getattribute__(self, name: str) -> Any:
        if name in OUTSIDE:
            type(self).requests += 1
            if type(self).is_cut:
                raise StoreUnavailable("no network")
        return super().__getattribute__(name)


@dataclass
class World:
    """A remote store with a map, and the robot's disk."""

    store: Store
    disk: Path
    told: list[str] = field(default_factory=list)

    @property
    def catalog(self) -> Catalog:
        return Catalog(self.store)

    def publish(self, built: Any) -> str:
        return self.catalog.publish("yard", built.directory, built.manifest)

    def start(self, update_every_s: float = 3600.0) -> EmbeddedLocalizer:
        """A robot's process. It looks at the store when it is told to, unless given a time."""
        last = LastServed(self.disk / "last", "memory://", "yard")
        tell = self.told.append
        localizer = EmbeddedLocalizer(
            self.catalog, "yard", self.disk / "versions", last, update_every_s=update_every_s, log_line=tell
        )
        localizer.start()
        return localizer


@pytest.fixture
def world(tmp_path: Path) -> World:
    class OfThisTest(RemoteStore):
        pass

    return World(OfThisTest.open("memory://"), tmp_path / "disk")


def cut(world: World, is_cut: bool = True) -> None:
    type(world.store).is_cut = is_cut  # type: ignore[attr-defined]


def requests(world: World) -> int:
    return type(world.store).requests  # type: ignore[attr-defined,no-any-return]


def plain(answer: Localization) -> dict[str, Any]:
    """Everything in an answer but the times that it took."""
    return {key: value for key, value in answer.to_mapping().items() if key != "timings_ms"}


def as_sent(answer: Localization) -> Localization:
    """The answer as a client reads it from JSON: quaternions that became matrices."""
    return Localization.from_mapping(json.loads(json.dumps(answer.to_mapping())))


@pytest.mark.timeout(900)  # each scan is answered twice
def test_the_answers_are_those_of_the_service(
    small_version, small_scans, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    store = tmp_path / "store"
    version = Catalog(Store.open(str(store))).publish("yard", small_version.directory, small_version.manifest)
    asked = [
        LocalizeOptions(),
        LocalizeOptions(gravity=np.array([0.0, 0.0, -1.0])),
        LocalizeOptions(T_base_sensor=from_quaternion([0.2, 0.0, 0.7], [0, 0, 1, 0])),
    ]
    verdicts = set()
    with (
        local_service(tmp_path / "service", store) as service,
        Client(service.url) as client,
        answerer(
            "yard", url=None, zenoh=None, store=str(store), timeout_s=30, follow=lambda line: None
        ) as ask,
    ):
        for number, (scan, _) in enumerate(small_scans):
            options = asked[number % len(asked)]
            message = cdr(cloud_of_points(scan.points))
            received = decode_point_cloud2(message, SCAN_LIMITS).scan()
            ours = ask(received, options)
            theirs = client.localize_body(message, POINT_CLOUD2, map_id="yard", options=options)
            assert plain(as_sent(ours)) == plain(theirs)
            verdicts.add(ours.verdict)
            assert ours.map_version == version
            # As the client sends a scan by itself: to the centimetre.
            rounded = client.localize(received, map_id="yard", options=options)
            if ours.T_map_sensor is not None and rounded.T_map_sensor is not None:
                off_m, off_deg = pose_error(ours.T_map_sensor, rounded.T_map_sensor)
                assert off_m < 0.02
                assert off_deg < 0.3
    assert Verdict.LOCALIZED in verdicts


def test_a_new_version_takes_the_place_of_the_old_one(
    coarse_version, small_version, small_scans, world: World
):
    first = world.publish(coarse_version)
    robot = world.start(update_every_s=0.05)
    answers: list[str] = []
    failed: list[BaseException] = []
    stop = threading.Event()

    def ask() -> None:
        while not stop.is_set():
            try:
                answers.append(robot(small_scans[0][0], OPTIONS).map_version)
            except BaseException as error:
                failed.append(error)
                return

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        wait_until(lambda: answers)
        second = world.publish(small_version)
        wait_until(lambda: answers[-1] == second or failed)
    finally:
        stop.set()
        thread.join(LIMIT_S)
    robot.close()
    assert not failed
    swap = answers.index(second)
    assert set(answers[:swap]) == {first}
    assert set(answers[swap:]) == {second}
    assert [line.split()[1] for line in world.told] == [first[:12], second[:12]]


def test_without_a_network_the_old_version_goes_on(coarse_version, small_version, small_scans, world: World):
    first = world.publish(coarse_version)
    robot = world.start(update_every_s=0.02)
    wait_until(lambda: robot.version == first)
    second = world.publish(small_version)
    before = requests(world)
    cut(world)
    wait_until(lambda: requests(world) > before + 3)  # several looks
    assert robot(small_scans[0][0], OPTIONS).map_version in (first, second)
    assert world.told.count("no network") == 1, "told once, however long it lasts"
    cut(world, False)
    wait_until(lambda: robot.version == second)
    robot.close()


@pytest.mark.parametrize("is_new_boot", [False, True])
def test_a_robot_that_starts_without_a_network_answers(
    small_version, small_scans, world: World, is_new_boot: bool, monkeypatch: pytest.MonkeyPatch
):
    version = world.publish(small_version)
    robot = world.start()
    expected = [plain(robot(scan, OPTIONS)) for scan, _ in small_scans[:5]]
    robot.close()
    cut(world)
    if is_new_boot:  # its files are read again, and none is fetched
        monkeypatch.setattr(version_cache, "_boot_id", lambda: "of the next start")
    again = world.start()
    assert again.version == version
    assert [plain(again(scan, OPTIONS)) for scan, _ in small_scans[:5]] == expected
    again.close()


def test_a_start_from_the_cache_sends_no_request_before_it_answers(small_version, world: World):
    version = world.publish(small_version)
    world.start().close()
    before = requests(world)
    last = LastServed(world.disk / "last", "memory://", "yard")
    robot = EmbeddedLocalizer(world.catalog, "yard", world.disk / "versions", last)
    robot._load_last()
    assert robot.version == version
    assert requests(world) == before
    robot.close()


def test_a_robot_that_never_had_the_map_waits_for_the_network(small_version, small_scans, world: World):
    version = world.publish(small_version)
    cut(world)
    robot = world.start(update_every_s=0.02)
    with pytest.raises(StoreUnavailable, match="no version of map yard was fetched yet"):
        robot(small_scans[0][0], OPTIONS)
    cut(world, False)
    wait_until(lambda: robot.version == version)
    assert robot(small_scans[0][0], OPTIONS).map_version == version
    robot.close()


def damage_cache(world: World, version: str) -> None:
    for path in (world.disk / "versions" / version).glob("*.npy"):
        path.write_bytes(path.read_bytes()[:-1] + b"\0\0")


def test_a_damaged_cache_is_fetched_again(small_version, small_scans, world: World):
    version = world.publish(small_version)
    world.start().close()
    damage_cache(world, version)
    cut(world)
    robot = world.start()
    assert robot.version is None
    cut(world, False)
    assert robot.update()
    assert robot.version == version
    robot.close()


def test_a_version_that_cannot_be_used_is_left_out(
    coarse_version, small_version, small_scans, world: World, monkeypatch: pytest.MonkeyPatch
):
    first = world.publish(coarse_version)
    robot = world.start()
    second = world.publish(small_version)
    key = next(item.key for item in world.store.scan("maps") if second in item.key and "npy" in item.key)
    good = world.store.get(key)
    world.store.put(key, b"x" + good[1:])
    assert not robot.update()
    assert robot(small_scans[0][0], OPTIONS).map_version == first
    assert any(line.startswith(f"version {second[:12]} cannot be used") for line in world.told)
    told = len(world.told)
    assert not robot.update(), "it is not fetched again at once"
    assert len(world.told) == told
    robot.close()

    cold = World(world.store, world.disk.with_name("another-robot")).start()
    assert cold.version == first, "as in the service"
    world.store.put(key, good)
    monkeypatch.setattr(embedded, "_REFUSED_FOR_S", -1.0)
    cold._refused_until.clear()
    cold.update()
    assert cold.version == second
    cold.close()


def test_a_map_that_was_taken_away_has_no_answer(small_version, small_scans, world: World):
    version = world.publish(small_version)
    robot = world.start()
    world.catalog.retire("yard", version, force=True)
    with pytest.raises(NotFound):
        robot.update()
    with pytest.raises(NotFound, match="no active version"):
        robot(small_scans[0][0], OPTIONS)
    robot.close()
    with pytest.raises(NotFound):  # it does not come back with the next start
        world.start()


def test_a_map_that_never_was_is_an_error_at_the_start(world: World):
    with pytest.raises(NotFound, match="yard"):
        world.start()


def test_only_the_active_version_answers(small_version, small_scans, world: World):
    version = world.publish(small_version)
    robot = world.start()
    assert robot(small_scans[0][0], LocalizeOptions(version=version)).map_version == version
    with pytest.raises(InvalidOption, match="only the active version"):
        robot(small_scans[0][0], LocalizeOptions(version="ab" * 32))
    robot.close()


def test_a_disk_that_cannot_be_written_does_not_stop_it(
    small_version, small_scans, world: World, monkeypatch: pytest.MonkeyPatch
):
    def refuse(*_: object) -> None:
        raise OSError("read-only file system")

    monkeypatch.setattr(LastServed, "write", refuse)
    version = world.publish(small_version)
    robot = world.start()
    assert robot.version == version
    assert any("the next start needs the store" in line for line in world.told)
    robot.close()


def test_a_defect_does_not_end_the_updates(small_version, world: World, monkeypatch: pytest.MonkeyPatch):
    version = world.publish(small_version)
    updates: list[Callable[[], bool]] = []

    def broken(self: EmbeddedLocalizer) -> bool:
        updates.append(self.update)
        raise RuntimeError("a defect")

    cut(world)
    robot = world.start(update_every_s=0.02)
    with monkeypatch.context() as patch:
        patch.setattr(EmbeddedLocalizer, "update", broken)
        wait_until(lambda: len(updates) > 3)
    cut(world, False)
    wait_until(lambda: robot.version == version)
    robot.close()
    assert world.told.count("RuntimeError('a defect')") == 1


def test_all_its_errors_are_ours():
    """The gateway reports these and tries again."""
    assert all(issubclass(error, FirstfixError) for error in (StoreUnavailable, NotFound, VersionError))


def test_scans_of_several_threads(small_version, small_scans, world: World):
    """Each robot of a fleet asks in a thread of its own."""
    world.publish(small_version)
    robot = world.start()
    scans: list[Scan] = [scan for scan, _ in small_scans[:6]]
    expected = [plain(robot(scan, OPTIONS)) for scan in scans]
    found: dict[int, dict[str, Any]] = {}

    def ask(number: int) -> None:
        found[number] = plain(robot(scans[number], OPTIONS))

    threads = [threading.Thread(target=ask, args=[number]) for number in range(len(scans))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(LIMIT_S)
    robot.close()
    assert [found[number] for number in range(len(scans))] == expected

"""Recorded queries are confirmed by the command line, and asked by the self-test of the next build."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml

from firstfix.answer.options import LocalizeOptions
from firstfix.transform import quaternion_of
from firstfix_cli.local_service import local_service
from firstfix_client import Client
from tests.commands import firstfix
from tests.small_world import CONFIG, SENSOR, begun_as
from tests.waiting import LIMIT_S, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]  # two builds by a service

ASKED = 8


@dataclass(frozen=True)
class Robots:
    """A service that records every query, whose map was built by it.

    Attributes:
        poses: of the scans, each as ``--pose`` takes it.
    """

    store: Path
    url: str
    poses: list[str]

    def run(self, *arguments: object, code: int = 0) -> str:
        """Runs a command, checks its exit code and returns its output."""
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("FIRSTFIX_URL", self.url)
            patch.setenv("FIRSTFIX_STORE", str(self.store))
            said = firstfix(*arguments, code=code)
        return said.out + said.error

    def recorded(self) -> list[dict[str, Any]]:
        """The recorded queries, oldest first."""
        recorded_queries: list[dict[str, Any]] = httpx.get(f"{self.url}/recorded-queries").json()["queries"]
        return sorted(recorded_queries, key=lambda one: str(one["query_id"]))

    def active(self) -> str:
        """Digest of the version that answers."""
        (one,) = httpx.get(f"{self.url}/maps").json()["maps"]
        return str(one["active_version"])

    def report(self) -> dict[str, Any]:
        """The self-test of the active version."""
        shown: dict[str, Any] = json.loads(self.run("maps", "show", "yard", "--store", self.store, "--json"))
        return dict(shown["manifest"]["self_test"])


@pytest.fixture(scope="module")
def robots(small_map, small_scans, small_version, tmp_path_factory) -> Iterator[Robots]:
    root = tmp_path_factory.mktemp("robots")
    sensor, config = root / "sensor.yaml", root / "build.yaml"
    sensor.write_text(yaml.safe_dump(SENSOR))
    stages = {name: CONFIG[name] for name in CONFIG if name != "sensor"}
    config.write_text(yaml.safe_dump({**stages, "provisional": False}))
    begun_as(small_version, root / "service" / "work" / "build")
    poses = [",".join(map(str, [*T[:3, 3], *quaternion_of(T)])) for _, T in small_scans[:ASKED]]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(root / "cache"))
        patch.setenv("FIRSTFIX_RECORDED_SHARE", "1")
        patch.setenv("FIRSTFIX_RECORDED_SHARE_LOCALIZED", "1")
        with local_service(root / "service", root / "store") as service, Client(service.url) as client:
            robots = Robots(root / "store", service.url, poses)
            robots.run("build", small_map, "--map-id", "yard", "--sensor", sensor, "--config", config)
            for number, (scan, _) in enumerate(small_scans[:ASKED]):
                strict = LocalizeOptions(min_probability=1.0 if number == 2 else None)
                client.localize(scan, map_id="yard", options=strict)
            wait_until(lambda: len(robots.recorded()) == ASKED)
            yield robots


def test_confirmed_queries_are_asked_by_the_next_build(robots):
    assert robots.report()["real"] == {}
    recorded = robots.recorded()
    for one, pose in zip(recorded, robots.poses, strict=True):
        if one["answer"]["T_map_sensor"] is None:
            told = robots.run("recorded", "confirm", one["query_id"], code=2)
            assert "answered without a pose: give --pose" in told
            robots.run("recorded", "confirm", one["query_id"], "--pose", pose)
        else:
            assert robots.run("recorded", "confirm", one["query_id"]) == f"{one['query_id']}  confirmed\n"
    assert {one["answer"]["verdict"] for one in recorded} > {"localized"}, "of both kinds"
    first, second, *_ = (one["query_id"] for one in recorded)
    robots.run("recorded", "confirm", first, "--pose", "0,0,30,0,0,0,1")  # in the air
    robots.run("recorded", "confirm", second, "--undo")
    assert [one["truth"] is None for one in robots.recorded()] == [number == 1 for number in range(ASKED)]

    before = robots.active()
    robots.run("maps", "rebuild", "yard")
    wait_until(lambda: robots.active() != before, limit_s=6 * LIMIT_S)
    real = robots.report()["real"]
    assert (real["asked"], real["confirmed"]["asked"]) == (ASKED - 2, ASKED - 2)
    assert real["success"]["0.2m"] > 0, "localized answers were right"
    assert list(real["left_out"]) == [first]
    assert "does not fit the map" in real["left_out"][first]
    assert f"{ASKED - 2} of them queries of" in robots.run("maps", "show", "yard", "--store", robots.store)


@pytest.mark.parametrize("pose", ["1,2,3", "a,b,c,d,e,f,g", "1,2,3,0,0,0,0", "nan,0,0,0,0,0,1"])
def test_an_invalid_pose_is_refused(robots, pose):
    last = robots.recorded()[-1]
    robots.run("recorded", "confirm", last["query_id"], "--pose", pose, code=2)
    assert robots.recorded()[-1]["truth"] == last["truth"]


def test_an_unknown_query_is_named(robots):
    told = robots.run("recorded", "confirm", "20260302t090000000000-0000000a", code=2)
    assert "20260302t090000000000-0000000a" in told

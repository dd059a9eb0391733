"""From a map file to a fix by the command line alone: build, serve, localize, maps."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml

from firstfix.transform import quaternion_of
from firstfix.wire import scan as wire
from firstfix_cli.local_service import LocalService, local_service
from tests.commands import Said, firstfix
from tests.small_world import CONFIG, SENSOR, begun_as
from tests.waiting import LIMIT_S

PLACE = "yard"


@dataclass(frozen=True)
class Shop:
    """A store with one map, scans with known poses, and a service over it."""

    store: Path
    poses: Path
    built: dict
    service: LocalService


def in_a_process(*arguments: object, code: int = 0) -> Said:
    """Runs a command as a process of its own and checks its exit code."""
    command = [sys.executable, "-m", "firstfix_cli.main", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=3 * LIMIT_S, check=False)
    assert done.returncode == code, done.stderr
    return Said(done.stdout, done.stderr)


@pytest.fixture(scope="module")
def shop(small_map, small_scans, small_version, tmp_path_factory) -> Iterator[Shop]:
    root = tmp_path_factory.mktemp("shop")
    # A command that understood the config otherwise would not go on from these stages.
    begun_as(small_version, root / "work" / PLACE / "build")
    sensor, config, store = root / "sensor.yaml", root / "build.yaml", root / "store"
    sensor.write_text(yaml.safe_dump(SENSOR))
    config.write_text(yaml.safe_dump({name: CONFIG[name] for name in CONFIG if name != "sensor"}))
    arguments = ["--map-id", PLACE, "--store", store, "--work", root / "work", "--json"]
    given = [*arguments, "--sensor", sensor, "--config", config]
    built = json.loads(in_a_process("build", small_map, *given).out)
    with (root / "poses.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scan", "tx", "ty", "tz", "qx", "qy", "qz", "qw"])
        for number, (scan, T) in enumerate(small_scans[:8]):
            name = f"{number:02}.ffscan"
            (root / name).write_bytes(wire.encode_scan(scan))
            writer.writerow([name, *T[:3, 3], *quaternion_of(T)])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(root / "cache"))
        with local_service(root / "service", store) as service:
            yield Shop(store, root / "poses.csv", built, service)


def ways(shop: Shop) -> dict[str, list[object]]:
    return {
        "http": ["--url", shop.service.url],
        "zenoh": ["--zenoh", shop.service.zenoh],
        "store": ["--store", shop.store],
    }


def test_a_build_prints_its_result(shop, small_version):
    assert shop.built["map_id"] == PLACE
    assert shop.built["counts"]["templates"] > 50
    assert shop.built["self_test"]["queries"] == CONFIG["self_test"]["queries"]
    # the same map and config give the same version, whoever builds
    assert shop.built["version"] == small_version.manifest.digest


def test_the_built_map_is_listed_as_active(shop):
    for way in ("http", "store"):
        listed = json.loads(firstfix("maps", "ls", *ways(shop)[way], "--json").out)
        (one,) = listed["maps"]
        assert (one["map_id"], one["active_version"]) == (PLACE, shop.built["version"])
        assert one["summary"]["sensor"] == "test-16"
    shown = [
        json.loads(firstfix("maps", "show", PLACE, *ways(shop)[way], "--json").out)
        for way in ("http", "store")
    ]
    assert shown[0] == shown[1]
    assert "self-test, 40 perturbed scans" in firstfix("maps", "show", PLACE, "--store", shop.store).out


@pytest.mark.parametrize("way", ["http", "zenoh", "store"])
def test_every_transport_gives_the_same_pose(shop, small_scans, way):
    scan = shop.poses.parent / "07.ffscan"
    answer = json.loads(firstfix("localize", scan, "--map", PLACE, *ways(shop)[way], "--json").out)
    assert answer["verdict"] == "localized"
    assert answer["map_version"] == shop.built["version"]
    assert np.linalg.norm(np.subtract(answer["T_map_sensor"]["position"], small_scans[7][1][:3, 3])) < 0.05
    told = firstfix("localize", scan, "--map", PLACE, *ways(shop)[way]).out
    assert told.startswith("localized, probability")
    assert f"version {shop.built['version'][:12]}" in told


def test_a_hopeless_scan_is_rejected_with_its_exit_code(shop, tmp_path):
    np.save(tmp_path / "dust.npy", np.random.default_rng(0).normal(0, 0.3, (5000, 3)))
    told = in_a_process("localize", tmp_path / "dust.npy", "--map", PLACE, *ways(shop)["http"], code=4)
    assert told.out.startswith("rejected")


def test_the_service_process_is_gone_afterwards(tmp_path):
    with local_service(tmp_path / "service", tmp_path / "store") as service:
        assert len(firstfix("maps", "ls", "--url", service.url).out.splitlines()) == 1  # the header
    assert "no answer from" in firstfix("maps", "ls", "--url", service.url, code=1).error

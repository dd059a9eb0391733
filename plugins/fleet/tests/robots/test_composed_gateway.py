"""A robot of another DDS, and the service and the gateway of deploy/compose."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
import pytest

from plugins.fleet.tests.robots import rust_robot
from plugins.fleet.tests.robots.dds_world import check_pose, scenes
from tests.claimed import any_domain
from tests.dds_loopback import LOOPBACK
from tests.deploy.engine import ROOT, build_images, compose, docker, running_engine
from tests.recorded_data import HALL
from tests.robots.robot_program import BASE
from tests.servers import free_port
from tests.waiting import wait_until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(3600)]  # images are built

COMPOSE = ROOT / "deploy" / "compose"
GATEWAY = "ros-gateway-dds"
STARTS, WITHIN_M = 3, 0.2


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with running_engine(tmp_path_factory.mktemp("engine") / "dockerd.log"):
        build_images("service", "builder")
        yield


class Composed:
    """A project of compose with the profile minimal, and a place for its settings."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.name = f"firstfix-test-gateway-{os.getpid()}"
        self.url = f"http://127.0.0.1:{(port := free_port())}"
        subprocess.run([COMPOSE / "make-env.sh", folder / "env"], check=True, capture_output=True)
        self._command = [*compose(), "--env-file", str(folder / "env"), "-p", self.name]
        self._command += ["--profile", "minimal", "-f", str(COMPOSE / "compose.yaml")]
        self._settings = {
            **os.environ,
            "FIRSTFIX_HTTP_PORT": str(port),
            "FIRSTFIX_ZENOH_PORT": str(free_port()),
            "ROS_DOMAIN_ID": str(domain),
            "CYCLONEDDS_URI": LOOPBACK,
        }

    def __call__(self, *arguments: str) -> str:
        """Runs compose; what it printed."""
        done = subprocess.run(
            [*self._command, *arguments], env=self._settings, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, f"{' '.join(arguments)}: {done.stdout[-2000:]}{done.stderr[-2000:]}"
        return done.stdout

    def add_gateway(self, key: str, map_id: str, base_frame: str) -> None:
        """From here on the gateway's file is beside that of the services."""
        self._command += ["-f", str(COMPOSE / "gateway-dds.yaml")]
        self._settings |= {"FIRSTFIX_GATEWAY_KEY": key, "FIRSTFIX_GATEWAY_MAP": map_id}
        self._settings |= {"FIRSTFIX_ROBOTS_BASE_FRAME": base_frame}


@contextmanager
def service_and_gateway(folder: Path, store: Path, map_id: str, domain: int) -> Iterator[Composed]:
    """Brings both up as the page says, with the maps of a store, as long as the block lasts."""
    project = Composed(folder, domain)
    try:
        project("up", "-d")
        volumes = ("-v", f"{project.name}_maps:/var/lib/firstfix", "-v", f"{store}:/from:ro")
        docker("run", "--rm", *volumes, "firstfix-builder", "copy-store", "/from", "/var/lib/firstfix/store")
        wait_until(lambda: _is_ready(project.url), what="the service")
        create = ("keys", "create", "--scope", "localize", "--map", map_id, "--name", "gateway")
        key = project("exec", "-T", "firstfix", "firstfix", *create).strip()
        project.add_gateway(key, map_id, BASE)
        project("up", "-d", GATEWAY)
        wait_until(lambda: "looking for robots on DDS" in project("logs", "--no-color", GATEWAY))
        yield project
    finally:
        project("down", "--volumes", "--timeout", "10")


def _is_ready(url: str) -> bool:
    try:
        return httpx.get(f"{url}/readyz").status_code == 200
    except httpx.TransportError:
        return False


def test_robots_get_their_pose_from_the_gateway_in_a_container(
    images: None, program: Path, hall_store: Path, tmp_path: Path
):
    domain, far = any_domain(), []
    seen = scenes(HALL.write_queries(tmp_path / "poses.csv"), tmp_path, STARTS)
    with service_and_gateway(tmp_path, hall_store, "hall", domain):
        for number, scene in enumerate(seen):
            with rust_robot.rust_robot(program, f"/robot{number}", domain) as robot:
                robot.wait_until_known()
                robot.show(scene.points, scene.T_map_sensor)
                far.append(check_pose(robot.wait_for("initialpose"), scene))
    assert max(far) < WITHIN_M, far

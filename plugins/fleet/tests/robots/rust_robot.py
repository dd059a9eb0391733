"""The robot of the folder ``robot``: built here, run as a program, steered and heard by lines of JSON."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from tests.robots.robot_program import FIXED_FRAMES, IMU, SENSOR, RobotProgram

SOURCE = Path(__file__).resolve().parent / "robot"
PACKAGE = SOURCE.parents[4] / "build" / "robot"  # `make clean` removes it
PROGRAM = PACKAGE / "robot"
# All checkouts of a user share it, as they share cargo's downloads: the crates are compiled once.
TARGET = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "firstfix-tests" / "robot"
OLDEST_CARGO = (1, 88)  # which the crate ros2-client needs


def missing() -> str | None:
    """Returns the reason why the robot cannot be built here, or None. It loads the crates."""
    if shutil.which("cargo") is None:
        return "needs cargo, which builds the robot: apt-get install cargo-web (Debian 12) or cargo"
    told = subprocess.run(["cargo", "--version"], capture_output=True, text=True, check=False).stdout
    found = re.match(r"cargo (\d+)\.(\d+)", told)
    if found is None or tuple(map(int, found.groups())) < OLDEST_CARGO:
        return f"the robot needs cargo {'.'.join(map(str, OLDEST_CARGO))}, here is: {told.strip() or 'none'}"
    try:
        _lay_out()
        _cargo("fetch", "--locked")
    except RuntimeError as error:
        return f"the robot's crates cannot be had: {error}"
    return None


def build() -> Path:
    """Builds the robot after ``missing``, where it is not up to date, and returns its program.

    The first time takes about two minutes of a processor.
    """
    _cargo(
        "build", "--locked", "--offline", "--target-dir", str(TARGET), "--config", "profile.dev.debug=false"
    )
    shutil.copy2(TARGET / "debug" / "robot", PROGRAM)
    return PROGRAM


def _lay_out() -> None:
    """Makes a package to be built. The pinned versions do not name the registry: cargo says where it is."""
    shutil.copytree(SOURCE, PACKAGE, dirs_exist_ok=True)
    lock = PACKAGE / "Cargo.lock"
    if not lock.exists():
        _cargo("generate-lockfile")
    registry = next(line for line in lock.read_text().splitlines() if line.startswith("source = "))
    pinned = (SOURCE / "Cargo.lock.pinned").read_text()
    lock.write_text(pinned.replace("\nchecksum = ", f"\n{registry}\nchecksum = "))


def _cargo(*arguments: str) -> None:
    done = subprocess.run(["cargo", *arguments], cwd=PACKAGE, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])


@contextmanager
def rust_robot(
    program: Path,
    namespace: str,
    domain: int,
    *,
    network: str = "127.0.0.1",
    around: Sequence[str] = (),
    reliable_clouds: bool = False,
) -> Iterator[RobotProgram]:
    """Runs a robot as long as the block lasts.

    Args:
        network: address of the only interface that it uses.
        around: command that runs its program.
        reliable_clouds: what is lost of a cloud is sent again; else clouds have the quality of sensor data.
    """
    options = {
        "domain": domain,
        "network": network,
        "namespace": namespace,
        "reliable_clouds": reliable_clouds,
        "service_mapping": "cyclone",
        "sensor_frame": SENSOR,
        "imu_frame": IMU,
        "frames": FIXED_FRAMES,
    }
    robot = RobotProgram([*around, program, json.dumps(options)])
    try:
        yield robot
    finally:
        robot.end()

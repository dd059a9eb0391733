"""The robot of the folder ``robot``: built here, run as a program, steered and heard by lines of JSON."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, from_quaternion, quaternion_of
from tests.waiting import LIMIT_S, wait_until

SOURCE = Path(__file__).resolve().parent / "robot"
PACKAGE = SOURCE.parents[2] / "build" / "robot"  # `make clean` removes it
TARGET = PACKAGE / "target"
PROGRAM = TARGET / "debug" / "robot"
OLDEST_CARGO = (1, 88)  # which the crate ros2-client needs
GRAVITY_M_S2 = 9.81
BASE, SENSOR, IMU = "base_link", "os_sensor", "imu_link"
# Not square, so that a frame that is taken for another shows.
T_BASE_SENSOR = from_quaternion([0.2, -0.1, 0.6], [0.0, 0.0, 0.6, 0.8])
T_SENSOR_IMU = from_quaternion([0.0, 0.0, 0.05], [0.0, 0.7071067811865476, 0.0, 0.7071067811865476])


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

    It takes about two minutes of a processor.
    """
    _cargo("build", "--locked", "--offline", "--target-dir", str(TARGET))
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


class RustRobot:
    """A running robot.

    Attributes:
        events: all that it said.
    """

    def __init__(self, program: Path, around: Sequence[str], options: dict[str, Any]) -> None:
        self.events: list[dict[str, Any]] = []
        self._process = subprocess.Popen(
            [*around, program, json.dumps(options)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def show(self, points: Path, T_map_sensor: Matrix) -> None:
        """Gives its sensors something to see: a file of ``write_points``, from a pose at rest."""
        up = T_map_sensor[2, :3] * GRAVITY_M_S2  # an accelerometer at rest feels the floor
        self._tell(show={"points": str(points), "acceleration": [*(T_SENSOR_IMU[:3, :3].T @ up)]})

    def call(self, number: int) -> None:
        """Calls the service, as soon as it is found."""
        self._tell(call=number)

    def of(self, event: str) -> list[dict[str, Any]]:
        """Returns what it said of a kind of event."""
        return [one for one in list(self.events) if one["event"] == event]

    def wait_for(self, event: str, count: int = 1) -> dict[str, Any]:
        """Waits until it said so much of a kind of event, and returns the last of these."""
        wait_until(lambda: len(self.of(event)) >= count or self._process.poll() is not None, what=event)
        assert self._process.poll() is None, "the robot's program ended"
        return self.of(event)[count - 1]

    def wait_until_known(self) -> None:
        """Waits until the gateway and the robot know each other's topics. The status is the last of them."""
        self.wait_for("service")
        self.wait_for("first_fix/status")

    def has_response(self, number: int) -> bool:
        """Returns whether the response to a call has come."""
        return any(one["call"] == number for one in self.of("response"))

    def end(self) -> None:
        """Ends it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(LIMIT_S)
        self._thread.join(LIMIT_S)

    def _tell(self, **command: Any) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(command) + "\n")
        self._process.stdin.flush()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.events.append(json.loads(line))


@contextmanager
def rust_robot(
    program: Path,
    namespace: str,
    domain: int,
    *,
    network: str = "127.0.0.1",
    around: Sequence[str] = (),
    reliable_clouds: bool = False,
) -> Iterator[RustRobot]:
    """Runs a robot as long as the block lasts.

    Args:
        network: address of the only interface that it uses.
        around: command that runs its program.
        reliable_clouds: what is lost of a cloud is sent again; else clouds have the quality of sensor data.
    """
    frames = [_frame(BASE, SENSOR, T_BASE_SENSOR), _frame(SENSOR, IMU, T_SENSOR_IMU)]
    options = {
        "domain": domain,
        "network": network,
        "namespace": namespace,
        "reliable_clouds": reliable_clouds,
        "service_mapping": "cyclone",
        "sensor_frame": SENSOR,
        "imu_frame": IMU,
        "frames": frames,
    }
    robot = RustRobot(program, around, options)
    try:
        yield robot
    finally:
        robot.end()


def _frame(parent: str, child: str, T: Matrix) -> dict[str, Any]:
    return {
        "parent": parent,
        "child": child,
        "translation": [*T[:3, 3]],
        "rotation": [float(one) for one in quaternion_of(T)],
    }


def write_points(scan: Scan, path: Path) -> Path:
    """Writes a scan's points as the robot reads them."""
    rows = np.zeros((len(scan.points), 4), "<f4")
    rows[:, :3] = scan.points
    path.write_bytes(rows.tobytes())
    return path


def stamp_ns(stamped: dict[str, int]) -> int:
    """Returns a time of an event in nanoseconds."""
    return stamped["sec"] * 10**9 + stamped["nanosec"]


def T_map_sensor_of(event: dict[str, Any]) -> Matrix:
    """Returns the sensor's pose (4, 4) by a heard pose of the base."""
    pose = event["message"]["pose"]["pose"]
    position, turn = pose["position"], pose["orientation"]
    T_map_base = from_quaternion([position[c] for c in "xyz"], [turn[c] for c in "xyzw"])
    return T_map_base @ T_BASE_SENSOR

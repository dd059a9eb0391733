"""The epoch of a fix: the same over restarts of the gateway, another one for another fix."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.ros.header import Stamp
from firstfix.transform import inverse, make_transform
from firstfix_ros.robot.epoch import Epoch
from firstfix_ros.robot.fix_memory import FixMemory
from firstfix_ros.robot.given_fix import GivenFix
from firstfix_ros.robot.handover import Stage
from firstfix_ros.robot.query import Fix
from firstfix_ros.robot.status import diagnosis_of
from tests.ros2.test_handover import AWAY, HERE, T_MAP_ODOM, Robot


def restarted(robot: Robot, **config: Any) -> Robot:
    """The same robot, with a new gateway."""
    new = Robot.__new__(Robot)
    new.__dict__ |= robot.__dict__
    new.start(**config)
    return new


def epoch(robot: Robot) -> Epoch | None:
    return robot.bench.gateway.status.epoch


def test_twenty_restarts_of_the_gateway_give_no_second_epoch(tmp_path: Path):
    rng = np.random.default_rng(3)
    robot = Robot(memory=tmp_path)
    first = epoch(robot)
    robot.bench.localizers, robot.error = 1, HERE
    for _ in range(20):
        robot.drive(rng.uniform(0.5, 5))
        robot = restarted(robot, memory=tmp_path)
        assert epoch(robot) == first
        robot.drive(2)
        assert robot.stage is Stage.FOLLOWED
        assert not robot.poses, "the localizer is not set back"


def test_nor_before_a_localizer_has_come(tmp_path: Path):
    robot = Robot(memory=tmp_path)
    first = epoch(robot)
    for _ in range(20):
        robot.drive(1)
        robot = restarted(robot, memory=tmp_path)
        assert epoch(robot) == first
    robot.bench.localizers = 1
    robot.drive(1.5)
    assert len(robot.poses) == 1, "it may have missed the pose before"


def test_a_pose_that_is_published_once_is_published_after_a_restart(tmp_path: Path):
    robot = restarted(Robot(memory=tmp_path, repeat_s=0.0), memory=tmp_path, repeat_s=0.0)
    assert len(robot.poses) == 1


@pytest.mark.parametrize("why", ["asked for", "carried away", "odometry anew", "astray"])
def test_another_fix_has_another_epoch(tmp_path: Path, why: str):
    robot = Robot(memory=tmp_path)
    first = epoch(robot)
    assert first is not None
    if why == "asked for":
        robot.bench.gateway.relocalize()
        robot.bench.cloud(stamp_ns=robot.stamp_ns)
    else:
        if why == "carried away":  # odometry does not feel it
            robot.T_true = AWAY @ robot.T_true
            robot.set_back = inverse(T_MAP_ODOM) @ inverse(AWAY) @ T_MAP_ODOM
        elif why == "odometry anew":
            robot.set_back = AWAY
        else:
            robot.error, robot.set_back = AWAY, AWAY
        robot.drive(1)
        robot = restarted(robot, memory=tmp_path)
    second = epoch(robot)
    assert second is not None
    assert second.number > first.number
    assert robot.poses


def test_without_a_memory_the_numbers_ascend_all_the_same():
    robot = Robot()
    before = epoch(robot)
    robot.bench.gateway.relocalize()
    robot.bench.cloud(stamp_ns=robot.stamp_ns)
    after = epoch(robot)
    assert before is not None
    assert after is not None
    assert (before.number, after.number) == (9, 10), "the second since 1970, or one more"


def test_it_is_in_the_diagnostics(tmp_path: Path):
    robot = Robot(memory=tmp_path)
    values = diagnosis_of(robot.bench.gateway.status).values
    assert values["epoch"] == "/::9"
    assert (values["localizer"], values["pose_stamp"]) == ("published", "7.000000000")
    assert str(Epoch("/robot7", "0123456789abcdef", 12)) == "/robot7:0123456789ab:12"


def given(number: int = 5) -> GivenFix:
    T = make_transform(np.eye(3), [1.0, 2, 3])
    fix = Fix("base_link", Stamp(7, 8), T, np.eye(6) / 3, None)
    return GivenFix(Epoch("/robot7", "ab", number), "hall", fix)


def test_the_memory_is_read_again_and_robots_have_their_own(tmp_path: Path):
    told: list[str] = []
    FixMemory(tmp_path / "new", "/robot7", told.append).keep(given())
    read = FixMemory(tmp_path / "new", "/robot7", told.append).last
    assert read is not None
    assert read.to_mapping() == given().to_mapping()
    for other in ("", "/", "/robot", "/robot7/x", "/../robot7"):
        assert FixMemory(tmp_path / "new", other, told.append).last is None
    assert not told


@pytest.mark.parametrize(
    "damage", [b"", b"{}", b"[1]", b"\xff", b"[" * 5000, b"x" * 70_000, b'{"format": 2}']
)
def test_a_damaged_memory_is_told_and_replaced(tmp_path: Path, damage: bytes):
    told: list[str] = []
    FixMemory(tmp_path, "/robot7", told.append).keep(given())
    (path,) = tmp_path.iterdir()
    path.write_bytes(damage)
    memory = FixMemory(tmp_path, "/robot7", told.append)
    assert memory.last is None
    assert len(told) == 1
    memory.keep(given(6))
    assert FixMemory(tmp_path, "/robot7", told.append).last is not None


def test_a_memory_that_cannot_be_written_is_told(tmp_path: Path):
    (tmp_path / "file").write_text("no folder")
    told: list[str] = []
    memory = FixMemory(tmp_path / "file", "/robot7", told.append)
    memory.keep(given())
    assert memory.last is not None
    assert "not remembered" in told[-1]

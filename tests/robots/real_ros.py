"""A real ROS 2 as ``scripts/ros2.sh`` installs it: its Python, and the environment of who sources it."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.needs import needs

ROOT = Path(__file__).resolve().parents[2]
DISTRIBUTIONS = ("jazzy", "kilted")
ONE_AND_OTHERS = ("jazzy", pytest.param("kilted", marks=pytest.mark.slow))
FAST_DDS = "rmw_fastrtps_cpp"
# Of a ROS that is sourced where the tests run.
_OF_ROS = ("AMENT_PREFIX_PATH", "CYCLONEDDS_URI", "LD_LIBRARY_PATH", "PYTHONPATH", "RMW_IMPLEMENTATION")


@dataclass(frozen=True)
class RealRos:
    """One distribution, with rclpy on Fast DDS and the messages of a robot.

    Attributes:
        prefix: a virtual environment, which is ROS's install prefix, too.
    """

    distribution: str
    prefix: Path

    @property
    def python(self) -> Path:
        """Interpreter with ROS alone. Tests run firstfix with their own, in the same ``environment``."""
        return self.prefix / "bin" / "python"

    def environment(self, domain: int, more: Mapping[str, str] | None = None) -> dict[str, str]:
        """Returns the environment of a process that uses ROS: others are found on this machine alone.

        Args:
            domain: ROS domain, see ``claimed.any_domain``.
            more: variables that are set, too.
        """
        packages = self.prefix / "lib" / f"python3.{sys.version_info[1]}" / "site-packages"
        libraries = [self.prefix / "lib", *sorted(packages.glob("ros_*.libs"))]
        own = {name: value for name, value in os.environ.items() if name not in _OF_ROS}
        return own | {
            "AMENT_PREFIX_PATH": str(self.prefix),
            "LD_LIBRARY_PATH": os.pathsep.join(map(str, libraries)),
            "PYTHONPATH": str(packages),
            "PYTHONUNBUFFERED": "1",
            "RMW_IMPLEMENTATION": FAST_DDS,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DISTRO": self.distribution,
            "ROS_DOMAIN_ID": str(domain),
            "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1",  # else Python starts anew, to set what is set here
            **(more or {}),
        }


def real_ros(distribution: str) -> RealRos:
    """Returns an installed distribution; without it the test is skipped."""
    prefix = ROOT / ".venv" / f"ros-{distribution}"
    if not (prefix / ".made-of").exists():
        how = "make all-test-servers installs it on x86_64, with a C++ compiler"
        pytest.skip(needs(f"ROS 2 {distribution.capitalize()}", how))
    return RealRos(distribution, prefix)

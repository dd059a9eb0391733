"""Build hook of the robot's wheel: adds the modules of the core that the client and the ROS node import."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from import_closure import import_closure  # noqa: E402


class RobotWheel(BuildHookInterface):  # type: ignore[misc]
    """The hook that ``pyproject.toml`` names."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the modules to the wheel."""
        roots = {
            "firstfix": HERE.parents[1] / "core" / "firstfix",
            "firstfix_client": HERE / "firstfix_client",
            "firstfix_ros": HERE.parent / "ros2" / "firstfix_ros",
        }
        build_data["force_include"] |= {str(path): name for name, path in import_closure(roots).items()}

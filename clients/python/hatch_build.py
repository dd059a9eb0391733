"""Build hook of the robot's wheel: adds the modules of the core that the client and the ROS node import."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from import_closure import import_closure  # noqa: E402
from strip_spaces import strip_spaces  # noqa: E402
from strip_text import strip_text  # noqa: E402
from strip_types import strip_types  # noqa: E402

# Modules whose docstrings ``help`` shows to robot programmers.
DOCUMENTED = {"firstfix_client/client.py", "firstfix_client/calls/maps.py", "firstfix_client/calls/builds.py"}
# Programs that call ``localize_body`` encode scans with this module.
TYPED = {"firstfix/wire/scan.py"}
# The other modules of these rooms, and these modules, are not used by robot programs: they lose the
# annotations of all functions.
INTERNAL = (
    "firstfix/answer/quality.py",
    "firstfix/decode.py",
    "firstfix/descriptor/",
    "firstfix/formats/",
    "firstfix/ids.py",
    "firstfix/bit_exact/",
    "firstfix/ros/",
    "firstfix/scan/condense.py",
    "firstfix/scan/levelling.py",
    "firstfix/scan/reduction.py",
    "firstfix/transform.py",
    "firstfix/wire/",
    "firstfix_client/drivers/",
    "firstfix_client/steps/",
)


def shipped(name: str, source: str) -> str:
    """Returns a module's source as the wheel has it."""
    if name in DOCUMENTED:
        return strip_spaces(source)
    typed = strip_types(strip_text(source), public=name.startswith(INTERNAL) and name not in TYPED)
    return strip_spaces(typed)


class RobotWheel(BuildHookInterface):  # type: ignore[misc]
    """The hook that ``pyproject.toml`` names."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Writes the modules to a folder, and adds them to the wheel."""
        roots = {
            "firstfix": HERE.parents[1] / "core" / "firstfix",
            "firstfix_client": HERE / "firstfix_client",
            "firstfix_ros": HERE.parent / "ros2" / "firstfix_ros",
        }
        stripped = Path(self.directory) / "stripped"
        for name, path in import_closure(roots).items():
            target = stripped / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(shipped(name, path.read_text()) if path.suffix == ".py" else "")
            build_data["force_include"][str(target)] = name

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Removes the folder."""
        shutil.rmtree(Path(self.directory) / "stripped")

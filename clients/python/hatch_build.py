"""Puts into the robot's wheel what ``firstfix_client`` imports of the core, and nothing else."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))

from import_closure import import_closure  # noqa: E402
from strip_text import strip_text  # noqa: E402

# Whose docstrings ``help`` shows to people who write a robot's program.
DOCUMENTED = {"firstfix_client/client.py", "firstfix_client/calls/maps.py", "firstfix_client/calls/builds.py"}


class RobotWheel(BuildHookInterface):  # type: ignore[misc]
    """The hook that ``pyproject.toml`` names."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        core = HERE.parents[1] / "core" / "firstfix"
        stripped = Path(self.directory) / "stripped"
        files = import_closure({"firstfix": core, "firstfix_client": HERE / "firstfix_client"})
        for name, path in files.items():
            if name in DOCUMENTED or path.suffix != ".py":
                build_data["force_include"][str(path)] = name
                continue
            target = stripped / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(strip_text(path.read_text()))
            build_data["force_include"][str(target)] = name

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        shutil.rmtree(Path(self.directory) / "stripped")

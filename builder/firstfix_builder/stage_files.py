"""Files of stages and versions in their folders."""

from __future__ import annotations

import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

TRAJECTORY_FILE = "trajectory.npy"  # of a map that was read; chunks read it, too


def write_json(path: Path, value: Mapping[str, Any]) -> None:
    """Write values by name as a file of a version."""
    path.write_text(json.dumps(value, sort_keys=True, indent=1) + "\n")


def link_all(folder: Path, into: Path) -> None:
    """Link all files below a folder."""
    for path in folder.rglob("*"):
        if path.is_file():
            target = into / path.relative_to(folder)
            target.parent.mkdir(parents=True, exist_ok=True)
            link(path, target)


def link(source: Path, target: Path) -> None:
    """Link a file, or copy it where the file system cannot link."""
    try:
        target.hardlink_to(source)
    except OSError:  # another file system
        shutil.copyfile(source, target)

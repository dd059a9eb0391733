"""Files of a folder that count: hidden ones are of the operating system, as macOS's ``._map.pcd``."""

from __future__ import annotations

from pathlib import Path


def is_hidden(name: str) -> bool:
    """Whether a file or folder of this name does not count, neither for a map nor for its content's hash."""
    return name.startswith(".")


def visible_files(folder: Path) -> list[Path]:
    """Files of a folder itself, by name."""
    return sorted(path for path in folder.iterdir() if not is_hidden(path.name) and path.is_file())

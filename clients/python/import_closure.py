"""Modules that the robot needs: what ``firstfix_client`` and the ROS node import, at the top or later."""

from __future__ import annotations

from modulefinder import ModuleFinder
from pathlib import Path

PACKAGES = ("firstfix", "firstfix_client")
# With what only they import. Catalog and engine are for `localizer: local`, which needs firstfix itself.
LEFT_OUT = ["firstfix.catalog", "firstfix.engine", "firstfix.formats.dataset_files", "firstfix.recording"]


def import_closure(
    roots: dict[str, Path], start: str = "firstfix_client", guest: str = "firstfix_ros"
) -> dict[str, Path]:
    """The files of the wheel, by their path in it.

    Args:
        roots: package name to its folder.
        start: package to include whole; of the others only what is imported.
        guest: package that is installed beside the wheel, and imports from it. It is not included.
    """
    finder = ModuleFinder([str(root.parent) for root in roots.values()], excludes=LEFT_OUT)
    for root in (roots[name] for name in (start, guest) if name in roots):
        for path in sorted(root.rglob("*.py")):
            finder.import_hook(".".join(path.relative_to(root.parent).with_suffix("").parts))
    files = {f"{package}/py.typed": roots[package] / "py.typed" for package in PACKAGES}
    for name, module in finder.modules.items():
        package = name.partition(".")[0]
        if package in PACKAGES:
            path = Path(module.__file__)
            files[path.relative_to(roots[package].parent).as_posix()] = path
    return files

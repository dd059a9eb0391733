"""Modules that the robot needs: what ``firstfix_client`` and the ROS node import, at the top or later."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGES = ("firstfix", "firstfix_client")


def import_closure(
    roots: dict[str, Path], start: str = "firstfix_client", guest: str = "firstfix_ros"
) -> dict[str, Path]:
    """Returns the files of the wheel, by their path in it.

    Args:
        roots: package name to its folder.
        start: package to include whole; of the others only what is imported.
        guest: package that is installed beside the wheel, and imports from it. It is not included.

    Raises:
        ModuleNotFoundError: an import names a module that is not there.
    """
    whole = [roots[name] for name in (start, guest) if name in roots]
    waiting = [_module_name(root, path) for root in whole for path in sorted(root.rglob("*.py"))]
    found: dict[str, Path] = {}
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        path = _file_of(name, roots)
        if path is None:
            raise ModuleNotFoundError(f"no module {name}", name=name)
        found[name] = path
        parent = name.rpartition(".")[0]
        waiting += [parent] if parent else []
        waiting += [one for one in _imported(name, path, roots) if one not in found]
    files = {
        path.relative_to(_root_of(name, roots).parent).as_posix(): path
        for name, path in found.items()
        if name.partition(".")[0] != guest
    }
    for package in PACKAGES:
        files[f"{package}/py.typed"] = roots[package] / "py.typed"
    return files


def _imported(name: str, path: Path, roots: dict[str, Path]) -> Iterator[str]:
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name.partition(".")[0] in roots)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            source = ".".join([*above, *([node.module] if node.module else [])])
            if source.partition(".")[0] in roots:
                yield source
                members = (f"{source}.{alias.name}" for alias in node.names)
                yield from (member for member in members if _file_of(member, roots) is not None)


def _root_of(name: str, roots: dict[str, Path]) -> Path:
    return roots[name.partition(".")[0]]


def _file_of(name: str, roots: dict[str, Path]) -> Path | None:
    base = _root_of(name, roots).parent.joinpath(*name.split("."))
    candidates = (base / "__init__.py", base.with_name(f"{base.name}.py"))
    return next((path for path in candidates if path.is_file()), None)


def _module_name(root: Path, path: Path) -> str:
    parts = path.relative_to(root.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)

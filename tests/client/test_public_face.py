"""The public names of ``firstfix_client`` are listed, documented, and the only ones that ``dir`` shows."""

from __future__ import annotations

import ast
import inspect
import pkgutil
from importlib import import_module
from pathlib import Path

import pytest

import firstfix_client

README = Path(__file__).resolve().parents[2] / "clients" / "python" / "README.md"
SECTIONS = ("Args:", "Attributes:", "Raises:", "Returns:")


def public_members(kind: type) -> dict[str, object]:
    found = {name: getattr(kind, name) for name in dir(kind) if not name.startswith("_")}
    return {name: value for name, value in found.items() if callable(value) or isinstance(value, property)}


def test_dir_shows_the_public_names_and_nothing_else():
    for module in pkgutil.walk_packages(firstfix_client.__path__, "firstfix_client."):
        import_module(module.name)  # each becomes an attribute of the package
    assert hasattr(firstfix_client, "steps")
    assert dir(firstfix_client) == sorted(firstfix_client.__all__)
    given: dict[str, object] = {}
    exec("from firstfix_client import *", given)
    assert set(given) - {"__builtins__"} == set(firstfix_client.__all__)


def test_every_public_name_is_importable():
    assert sorted(firstfix_client._HOME) == sorted(firstfix_client.__all__)
    for name in firstfix_client.__all__:
        assert getattr(firstfix_client, name).__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'Kalman'"):
        firstfix_client.Kalman  # noqa: B018


def test_a_type_checker_sees_the_same_names():
    (block,) = (
        node
        for node in ast.parse(Path(firstfix_client.__file__).read_text()).body
        if isinstance(node, ast.If)
    )
    homes = {
        alias.name: "." * node.level + str(node.module)
        for node in block.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    assert homes == firstfix_client._HOME


@pytest.mark.parametrize("name", firstfix_client.__all__)
def test_every_public_name_is_documented(name: str):
    kind = getattr(firstfix_client, name)
    assert f"`{name}" in README.read_text()
    members = public_members(kind)
    for label, value in {name: kind, **members}.items():
        summary = (inspect.getdoc(value) or "").partition("\n")[0]
        assert summary, label
        assert not summary.startswith((f"{name}(", *SECTIONS)), label

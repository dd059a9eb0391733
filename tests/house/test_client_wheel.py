"""The robot's own distribution: its content, its size, and what it loads at start."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import traceback
import zipfile
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import tomllib

REPO = Path(__file__).resolve().parents[2]
CLIENT = REPO / "clients" / "python"
THREE = {"numpy", "httpx", "zstandard"}
MAX_WHEEL_BYTES = 110_000  # the signatures of zenoh queries have 5,000
# of three dependencies, and of what these bring themselves
KNOWN = {"anyio", "certifi", "h11", "httpcore", "idna", "sniffio", "typing_extensions", *THREE}
EXTRAS = {"zenoh", "laspy", "lzf"}  # imported where they are used, with a word on what to install

sys.path.insert(0, str(CLIENT))
from import_closure import import_closure  # noqa: E402
from strip_spaces import strip_spaces  # noqa: E402
from strip_text import strip_text  # noqa: E402
from strip_types import strip_types  # noqa: E402


@cache
def closure() -> dict[str, Path]:
    return import_closure(
        {
            "firstfix": REPO / "core" / "firstfix",
            "firstfix_client": CLIENT / "firstfix_client",
            "firstfix_ros": CLIENT.parent / "ros2" / "firstfix_ros",
        }
    )


def names_of(wanted: list[str]) -> set[str]:
    return {re.split(r"[\[<>=!~ ;]", one)[0] for one in wanted}


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if find_spec("hatchling") is None:
        pytest.skip("no hatchling: scripts/setup.sh installs it")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(command, cwd=CLIENT, check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel's modules in a folder, as pip would install them."""
    folder = tmp_path_factory.mktemp("installed")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder)
    return folder


def test_it_needs_three_packages():
    project = tomllib.loads((CLIENT / "pyproject.toml").read_text())["project"]
    assert names_of(project["dependencies"]) == THREE
    whole = tomllib.loads((REPO / "pyproject.toml").read_text())["project"]
    assert set(project["dependencies"]) == set(whole["dependencies"])
    assert project["optional-dependencies"]["zenoh"] == whole["optional-dependencies"]["zenoh"]


def imported_from_outside() -> Iterator[tuple[str, str]]:
    for name, path in closure().items():
        if path.suffix != ".py":
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                yield from ((name, alias.name.partition(".")[0]) for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and not node.level:
                yield name, str(node.module).partition(".")[0]


def test_what_it_imports_is_there_or_an_extra():
    own = {"firstfix", "firstfix_client"}
    unknown = {
        (name, module)
        for name, module in imported_from_outside()
        if module not in sys.stdlib_module_names | THREE | EXTRAS | own
    }
    assert not unknown


def test_the_closure_follows_every_kind_of_import(tmp_path: Path):
    core, client, node = (tmp_path / f"firstfix{end}" for end in ("", "_client", "_ros"))
    texts = {
        client / "__init__.py": "from .a import f\n",
        client / "a.py": "import firstfix.whole\nfrom firstfix import top\nfrom firstfix.deep.leaf import x",
        core / "__init__.py": "",
        core / "top.py": "def f():\n    from . import late\n",
        core / "late.py": "",
        core / "whole.py": "",
        core / "deep" / "__init__.py": "from ..shared import y\n",
        core / "deep" / "leaf.py": "from . import other\n",
        core / "deep" / "other.py": "",
        core / "shared.py": "",
        core / "unused.py": "",
        core / "of_the_node.py": "",
        node / "__init__.py": "",
        node / "node.py": "from firstfix.of_the_node import z\n",
    }
    for path, text in texts.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    for package in (core, client):
        (package / "py.typed").touch()
    found = import_closure({"firstfix": core, "firstfix_client": client, "firstfix_ros": node})
    expected = {path.relative_to(tmp_path).as_posix() for path in texts}
    expected -= {"firstfix/unused.py", "firstfix_ros/__init__.py", "firstfix_ros/node.py"}
    assert set(found) == expected | {"firstfix/py.typed", "firstfix_client/py.typed"}


def test_stripping_leaves_every_statement_on_its_line():
    source = (
        '"""Module."""\n\nimport sys  # why\n\n\nclass A:\n    """Of\n    several lines."""\n\n'
        '    def f(self):\n        """Only this."""\n\n    def g(self):\n        text = "# no comment"\n'
        "        raise ValueError(text)  # here\n"
    )
    stripped = strip_text(source)
    assert "Of" not in stripped
    assert "why" not in stripped
    space: dict[str, type] = {}
    exec(compile(stripped, "stripped.py", "exec"), space)
    with pytest.raises(ValueError, match="# no comment") as caught:
        space["A"]().g()
    assert traceback.extract_tb(caught.value.__traceback__)[-1].lineno == 15
    assert space["A"]().f() is None


TYPED = """
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from decimal import Decimal


@dataclass(frozen=True)
class Point:
    x_m: float = 0.0

    def scaled(self, by: Decimal | float, *, names: Mapping[str, Any] = {"a: b": 1}, **rest: int) -> Point:
        doubled: list[float] = [2 * self.x_m * by]
        return Point(doubled[0])


def _first(
    found: Mapping[
        str, Any
    ],
) -> Any:
    raise KeyError(found)
"""


@pytest.mark.parametrize("public", [True, False])
def test_stripping_types_leaves_the_behaviour_and_the_lines(public: bool):
    stripped = strip_types(TYPED, public=public)
    space: dict[str, Any] = {"__name__": __name__}
    exec(compile(stripped, "stripped.py", "exec"), space)
    assert space["Point"](1.5).scaled(2) == space["Point"](6.0)
    with pytest.raises(KeyError) as caught:
        space["_first"]({})
    assert (
        traceback.extract_tb(caught.value.__traceback__)[-1].lineno
        == TYPED.splitlines().index("    raise KeyError(found)") + 1
    )
    assert not space["_first"].__annotations__
    assert bool(space["Point"].scaled.__annotations__) is not public
    assert ("Decimal" in stripped) is not public
    assert ("Mapping" in stripped) is not public
    assert "doubled = [" in stripped


class Bare(ast.NodeTransformer):
    """Removes docstrings and annotations, and imports for annotations, from a syntax tree."""

    def visit(self, node: ast.AST) -> Any:
        self.generic_visit(node)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            node.body = [one for one in node.body if not is_text(one)]
        if isinstance(node, ast.arg):
            node.annotation = None
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            node.returns = None
        if isinstance(node, ast.AnnAssign) and node.value is not None:
            return ast.copy_location(ast.Assign([node.target], node.value), node)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            return None
        typing = isinstance(node, ast.ImportFrom) and node.module in TYPING
        return None if typing else node


TYPING = {"__future__", "collections.abc", "numpy.typing", "types", "typing"}


def is_text(node: ast.stmt) -> bool:
    """Returns True for a docstring, or the ellipsis in its place."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


def bare(source: str) -> tuple[str, list[int]]:
    """Returns the bare syntax tree as text, and the lines of its statements."""
    tree = Bare().visit(ast.parse(source))
    return ast.dump(tree), [node.lineno for node in ast.walk(tree) if isinstance(node, ast.stmt)]


def test_the_modules_of_the_wheel_do_what_their_sources_do(installed: Path):
    """Apart from docstrings and annotations their syntax trees are equal, line numbers included."""
    for name, path in closure().items():
        if path.suffix == ".py":
            assert bare((installed / name).read_text()) == bare(path.read_text()), name


def test_public_names_of_the_wheel_keep_their_types(installed: Path):
    program = f"""
import firstfix_client, inspect
assert firstfix_client.__file__.startswith({str(installed)!r})
for name in firstfix_client.__all__:
    kind = getattr(firstfix_client, name)
    for label, value in inspect.getmembers(kind, inspect.isroutine):
        if label.startswith("_") or not str(getattr(value, "__module__", "")).startswith("firstfix"):
            continue
        signature = inspect.signature(value)
        given = [one for one in signature.parameters.values() if one.name != "self"]
        untyped = [one for one in given if one.annotation is one.empty]
        assert not untyped, (name, label, untyped)
        assert signature.return_annotation is not signature.empty, (name, label)
"""
    modules_after(program, str(installed))


def test_the_wheel_is_small_and_whole(wheel: Path):
    assert wheel.stat().st_size < MAX_WHEEL_BYTES
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert held == set(closure())


@cache
def modules_after(statement: str, *path: str) -> set[str]:
    """Returns the modules of a fresh interpreter after the statement."""
    program = f"{statement}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path)},
        capture_output=True,
        check=True,
        text=True,
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_every_module_of_the_wheel_imports_without_the_rest(installed: Path):
    """The modules come from the wheel, not from this checkout."""
    names = [name.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for name in closure()]
    modules = [name for name in names if not name.endswith("py.typed")]
    blocked = ["scipy", "faiss", "pydantic", "zenoh", "yaml"]
    statement = f"import sys\nfor name in {blocked}: sys.modules[name] = None\n"
    statement += f"import firstfix\nassert firstfix.__file__.startswith({str(installed)!r})\n"
    statement += "\n".join(f"import {name}" for name in modules)
    assert set(modules) <= modules_after(statement, str(installed))


PLAIN = "import numpy, httpx, zstandard"
HERE = str(REPO / "core"), str(CLIENT)


def third_party(modules: set[str]) -> set[str]:
    tops = {name.partition(".")[0] for name in modules}
    return {
        top for top in tops if top not in sys.stdlib_module_names and not top.startswith(("_", "firstfix"))
    }


def test_the_package_alone_loads_nothing():
    assert not third_party(modules_after("import firstfix_client", *HERE) - modules_after("pass", *HERE))


def test_a_client_loads_less_than_its_dependencies():
    """Start-up: no network and no event loop before a client is made, nothing but the three after it."""
    before = modules_after("pass", *HERE)
    named = modules_after("from firstfix_client import Client, AsyncClient", *HERE) - before
    assert not {"httpx", "asyncio", "ssl", "zenoh"} & named
    made = modules_after("from firstfix_client import Client\nClient('http://localhost:1')", *HERE) - before
    assert not {"asyncio", "zenoh"} & (made - modules_after(PLAIN, *HERE))
    assert third_party(made) <= third_party(modules_after(PLAIN, *HERE)) | KNOWN


SPACED = '''
def scaled(x: float, *, by: dict[str, int] | None = None, **rest: int) -> list[float]:
    text = """first
        second  line"""
    if by is not None and "a  b" not in by:
        return [x ** -1 if x else - x for _ in range(3)]
    name = f"{x :.1f}  {{ {text!r} }}  = {by = }"
    raise KeyError(
        name, r" a ", b" b" if not rest else 1 .real
    )
'''


def test_stripping_spaces_leaves_the_syntax_and_the_lines():
    stripped = strip_spaces(SPACED)
    assert ast.dump(ast.parse(stripped)) == ast.dump(ast.parse(SPACED))
    assert [node.lineno for node in ast.walk(ast.parse(stripped)) if isinstance(node, ast.stmt)] == [
        node.lineno for node in ast.walk(ast.parse(SPACED)) if isinstance(node, ast.stmt)
    ]
    assert '\n if by is not None and "a  b" not in by:\n' in stripped
    assert "\n  return[x**-1 if x else-x for _ in range(3)]\n" in stripped
    assert '\n        second  line"""\n' in stripped

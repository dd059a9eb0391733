"""The robot's own distribution: what is in it, how large it is, and what starting it loads."""

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
from importlib.util import find_spec
from pathlib import Path

import pytest
import tomllib

REPO = Path(__file__).resolve().parents[2]
CLIENT = REPO / "clients" / "python"
THREE = {"numpy", "httpx", "zstandard"}
MAX_WHEEL_BYTES = 100_000
# of three dependencies, and of what these bring themselves
KNOWN = {"anyio", "certifi", "h11", "httpcore", "idna", "sniffio", "typing_extensions", *THREE}
EXTRAS = {"zenoh", "laspy", "lzf"}  # imported where they are used, with a word on what to install

sys.path.insert(0, str(CLIENT))
from import_closure import import_closure  # noqa: E402
from strip_text import strip_text  # noqa: E402


def closure() -> dict[str, Path]:
    core = REPO / "core" / "firstfix"
    return import_closure({"firstfix": core, "firstfix_client": CLIENT / "firstfix_client"})


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
    core, client = tmp_path / "firstfix", tmp_path / "firstfix_client"
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
    }
    for path, text in texts.items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text)
    for package in (core, client):
        (package / "py.typed").touch()
    found = import_closure({"firstfix": core, "firstfix_client": client})
    expected = {path.relative_to(tmp_path).as_posix() for path in texts} - {"firstfix/unused.py"}
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


def test_the_wheel_is_small_and_whole(wheel: Path):
    assert wheel.stat().st_size < MAX_WHEEL_BYTES
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if ".dist-info/" not in name}
    assert held == set(closure())


def modules_after(statement: str, path: list[str]) -> set[str]:
    """What a fresh interpreter holds after the statement, by top-level name."""
    program = f"{statement}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", program],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(path)},
        capture_output=True,
        check=True,
        text=True,
    )
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_every_module_of_the_wheel_imports_without_the_rest(wheel: Path):
    """From the wheel itself, which comes before what else is installed here."""
    names = [name.removesuffix(".py").removesuffix("/__init__").replace("/", ".") for name in closure()]
    modules = [name for name in names if not name.endswith("py.typed")]
    blocked = ["scipy", "faiss", "pydantic", "zenoh", "yaml"]
    statement = f"import sys\nfor name in {blocked}: sys.modules[name] = None\n"
    statement += "import firstfix\nassert '.whl' in firstfix.__file__\n"
    statement += "\n".join(f"import {name}" for name in modules)
    assert set(modules) <= modules_after(statement, [str(wheel)])


PLAIN = "import numpy, httpx, zstandard"
HERE = [str(REPO / "core"), str(CLIENT)]


def third_party(modules: set[str]) -> set[str]:
    tops = {name.partition(".")[0] for name in modules}
    return {
        top for top in tops if top not in sys.stdlib_module_names and not top.startswith(("_", "firstfix"))
    }


def test_the_package_alone_loads_nothing():
    assert not third_party(modules_after("import firstfix_client", HERE) - modules_after("pass", HERE))


def test_a_client_loads_less_than_its_dependencies():
    """Start-up: no network and no event loop before a client is made, nothing but the three after it."""
    before = modules_after("pass", HERE)
    named = modules_after("from firstfix_client import Client, AsyncClient", HERE) - before
    assert not {"httpx", "asyncio", "ssl", "zenoh"} & named
    made = modules_after("from firstfix_client import Client\nClient('http://localhost:1')", HERE) - before
    assert not {"asyncio", "zenoh"} & (made - modules_after(PLAIN, HERE))
    assert third_party(made) <= third_party(modules_after(PLAIN, HERE)) | KNOWN


def test_every_exported_name_is_where_it_is_said_to_be():
    program = "import firstfix_client as c\nfor name in c.__all__: getattr(c, name)\n"
    program += "assert set(c._HOME) == set(c.__all__)"
    modules_after(program, HERE)

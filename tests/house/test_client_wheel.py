"""The robot's own distribution: its content, its size, and what it loads at start."""

from __future__ import annotations

import ast
import json
import os
import re
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from functools import cache
from importlib.util import find_spec
from pathlib import Path

import pytest
import tomllib

REPO = Path(__file__).resolve().parents[2]
CLIENT = REPO / "clients" / "python"
THREE = {"numpy", "httpx", "zstandard"}
MAX_WHEEL_BYTES = 158_000
# of three dependencies, and of what these bring themselves
KNOWN = {"anyio", "certifi", "h11", "httpcore", "idna", "sniffio", "typing_extensions", *THREE}
EXTRAS = {"zenoh", "lzf"}  # imported where they are used, with a word on what to install

sys.path.insert(0, str(CLIENT))
from import_closure import import_closure  # noqa: E402


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


def test_the_modules_of_the_wheel_are_their_sources(installed: Path):
    for name, path in closure().items():
        assert (installed / name).read_bytes() == path.read_bytes(), name


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


def test_a_file_that_no_robot_records_is_refused_with_what_reads_it(installed: Path, tmp_path: Path):
    file = tmp_path / "scan.npy"
    file.write_bytes(b"any")
    program = "import pathlib, sys\nfrom firstfix.scan_file import read_scan_file\n"
    program += "read_scan_file(pathlib.Path(sys.argv[1]))"
    done = subprocess.run(
        [sys.executable, "-c", program, str(file)],
        env={**os.environ, "PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
    )
    assert "UnsupportedFormat" in done.stderr
    assert "install firstfix itself for .npy" in done.stderr


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

"""The console's page as it is built: its size, its first view, whom it asks, and the wheel with it."""

from __future__ import annotations

import gzip
import json
import re
import subprocess
import sys
import zipfile
from importlib.util import find_spec
from pathlib import Path

import pytest

REPO = Path(__file__).resolve().parents[3]
PAGE = REPO / "plugins" / "console" / "firstfix_console" / "files"
INSIDE_WHEEL = "firstfix_console/files/"
MAX_BYTES = 350 * 1024  # of all scripts and styles, packed
MAX_FIRST_BYTES = 50 * 1024  # of those that the list of maps needs
THREE = b"WebGLRenderer"  # the 3D library names its parts in messages

pytestmark = pytest.mark.skipif(not (PAGE / "index.html").is_file(), reason="needs the console: make console")


def packed_bytes(*paths: Path) -> int:
    return sum(len(gzip.compress(path.read_bytes(), 9)) for path in paths)


def scripts_and_styles() -> list[Path]:
    return [path for path in PAGE.rglob("*") if path.suffix in (".js", ".css")]


def first_files() -> set[Path]:
    """The files that the page names, and those that they import at once."""
    waiting = [
        PAGE / name for name in re.findall(r'(?:src|href)="\./([^"]+)"', (PAGE / "index.html").read_text())
    ]
    found: set[Path] = set()
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            named = re.findall(r'(?:from|import)\s*"\./([^"]+\.js)"', path.read_text())
            waiting += [path.parent / name for name in named]
    return found


def test_all_of_it_is_small():
    assert packed_bytes(*scripts_and_styles()) < MAX_BYTES


def test_the_list_of_maps_comes_without_the_3d_library():
    first = first_files()
    assert {path.suffix for path in first} == {".svg", ".js", ".css"}
    assert packed_bytes(*first) < MAX_FIRST_BYTES
    assert not [path.name for path in first if THREE in path.read_bytes()]
    assert [path for path in scripts_and_styles() if THREE in path.read_bytes()], "another file has it"


def test_it_names_its_files_without_a_host_and_without_the_root():
    """Behind a proxy the page lies under any prefix."""
    text = (PAGE / "index.html").read_text()
    named = re.findall(r'(?:src|href)="([^"]*)"', text)
    assert named
    assert all(name.startswith("./") for name in named)
    assert "<style" not in text
    assert not re.search(r"<script[^>]*>[^<]", text), "the policy of the page allows no script in it"
    assert not re.search(r"\son\w+=", text)


def test_its_styles_load_nothing_from_elsewhere():
    for path in PAGE.rglob("*.css"):
        assert not re.search(r"@import|url\((?!['\"]?(\./|data:))", path.read_text()), path.name


def test_the_licences_of_what_it_holds_are_with_it():
    notices = (PAGE / "notices.txt").read_text()
    packages = json.loads((REPO / "plugins/console/page/package.json").read_text())["dependencies"]
    missing = [name for name, version in packages.items() if f"## {name} - {version} (MIT)" not in notices]
    assert not missing


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The console's wheel."""
    if find_spec("hatchling") is None:
        pytest.skip("needs hatchling: scripts/setup.sh installs it")
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--no-build-isolation"]
    command += ["--no-index", "--wheel-dir", str(folder), str(REPO / "plugins/console")]
    subprocess.run(command, check=True, capture_output=True)
    (built,) = folder.glob("*.whl")
    return built


def test_the_wheel_has_the_page_and_none_of_its_sources(wheel: Path):
    with zipfile.ZipFile(wheel) as archive:
        held = {
            name.removeprefix(INSIDE_WHEEL) for name in archive.namelist() if name.startswith(INSIDE_WHEEL)
        }
        sources = [name for name in archive.namelist() if name.endswith((".ts", ".tsx", "package.json"))]
        for name in held:
            assert archive.read(INSIDE_WHEEL + name) == (PAGE / name).read_bytes()
    assert held == {path.relative_to(PAGE).as_posix() for path in PAGE.rglob("*") if path.is_file()}
    assert "index.html" in held
    assert not sources


def test_the_wheel_has_every_module(wheel: Path):
    with zipfile.ZipFile(wheel) as archive:
        held = {name for name in archive.namelist() if name.endswith(".py")}
    folder = REPO / "plugins/console"
    assert held == {path.relative_to(folder).as_posix() for path in folder.glob("firstfix_console/**/*.py")}

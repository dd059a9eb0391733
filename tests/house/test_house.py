"""Promises of the repository about itself: light imports, few needs, nothing of one machine."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import tomllib

REPO = Path(__file__).resolve().parents[2]
REGISTRY = re.compile(
    r"(pypi|pythonhosted|npmjs|registry\.[a-z]+|crates|proxy\.golang)\.(org|com|io|dev)\b|--(extra-)?index-url=?\s*http"
)
# By a computed step: a constant one is no sample.
STRIDE = re.compile(r"\[\s*::\s*(?!-?\d+\s*[\],])|\barange\(\s*0\s*,\s*len\([^)]*\)\s*,(?!\s*\d+\s*\))")
MACHINE = re.compile(r"(?<![\w.])/(work|root|tmp/(venv|clone))/")


def tracked_texts() -> list[tuple[str, str]]:
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=REPO, capture_output=True, check=False)
    if listing.returncode:
        pytest.skip("not a git checkout: what belongs to the repository is not known")
    texts = []
    for name in listing.stdout.decode().rstrip("\0").split("\0"):
        path = REPO / name
        if path.is_file() and name != Path(__file__).relative_to(REPO).as_posix():
            texts.append((name, path.read_bytes().decode("utf-8", errors="ignore")))
    return texts


def test_no_sample_is_a_stride_through_a_list():
    """``firstfix.bit_exact.sample`` takes samples: a stride of a list repeats with the list's period."""
    packages = ("core/", "builder/", "service/", "clients/python/", "cli/", "worlds/", "benchmarks/")
    found = [
        f"{name}: {line.strip()}"
        for name, text in tracked_texts()
        if name.startswith(packages) and name.endswith(".py")
        for line in text.splitlines()
        if STRIDE.search(line)
    ]
    assert not found


@pytest.mark.parametrize(
    ("line", "seen"),
    [
        ("points[::step]", True),
        ("points[:: len(points) // 100]", True),
        ("rows = np.arange(0, len(rows), -(-len(rows) // 10))", True),
        ("points[::-1]", False),
        ("pairs = numbers[::2]", False),
        ("for start in range(0, len(rows), AT_ONCE):", False),
    ],
)
def test_a_stride_is_seen(line: str, seen: bool):
    assert bool(STRIDE.search(line)) == seen


@pytest.mark.parametrize("pattern", [REGISTRY, MACHINE], ids=["registry host", "machine path"])
def test_no_file_names_a_place_outside(pattern: re.Pattern[str]):
    found = [
        f"{name}: {match.group(0)}" for name, text in tracked_texts() for match in pattern.finditer(text)
    ]
    assert not found


def test_the_readme_shows_the_two_commands():
    readme = (REPO / "README.md").read_text()
    assert "make demo" in readme
    assert "make test" in readme


def test_ci_runs_what_the_readme_says():
    assert "make test" in (REPO / ".ci" / "run").read_text()


def test_a_robot_needs_three_packages():
    project = tomllib.loads((REPO / "pyproject.toml").read_text())["project"]
    assert {re.split(r"[\[<>=!~ ;]", wanted)[0] for wanted in project["dependencies"]} == {
        "numpy",
        "httpx",
        "zstandard",
    }


HEAVY = [
    "eclipse_zenoh",
    "faiss",
    "fastapi",
    "obstore",
    "open3d",
    "pydantic",
    "scipy",
    "zenoh",
]


def heavy_modules_after(statement: str) -> set[str]:
    """The names of HEAVY that a fresh interpreter holds after the statement."""
    program = f"{statement}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, check=True, text=True)
    return set(HEAVY) & set(json.loads(run.stdout.splitlines()[-1]))


def all_modules_of(packages: list[str]) -> str:
    """A statement that imports every module of the packages."""
    return (
        "import importlib, pkgutil\n"
        f"for name in {packages}:\n"
        "    package = importlib.import_module(name)\n"
        "    for found in pkgutil.walk_packages(getattr(package, '__path__', []), name + '.'):\n"
        "        if not found.name.endswith('__main__'): importlib.import_module(found.name)"
    )


def test_importing_the_packages_imports_nothing_heavy():
    assert heavy_modules_after("import firstfix, firstfix_client") == set()


def test_the_robots_rooms_import_nothing_heavy():
    config = tomllib.loads((REPO / "pyproject.toml").read_text())
    contract = next(
        contract
        for contract in config["tool"]["importlinter"]["contracts"]
        if contract["name"].startswith("The robot's part")
    )
    rooms = [name for name in contract["source_modules"] if name != "firstfix_client"]
    assert "firstfix.scan" in rooms
    assert heavy_modules_after(all_modules_of(rooms)) == set()


def test_the_probe_for_heavy_modules_sees_one():
    assert heavy_modules_after("import scipy") == {"scipy"}


def test_the_service_never_imports_open3d():
    assert "open3d" not in heavy_modules_after(all_modules_of(["firstfix_service"]))

"""Promises of the repository about itself: no sample by stride, and nothing of one machine."""

import re
import subprocess
from collections import Counter
from pathlib import Path

import pytest

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
        pytest.skip("needs a git checkout, which knows what belongs to it: git clone")
    texts = []
    for name in listing.stdout.decode().rstrip("\0").split("\0"):
        path = REPO / name
        if path.is_file() and name != Path(__file__).relative_to(REPO).as_posix():
            texts.append((name, path.read_bytes().decode("utf-8", errors="ignore")))
    return texts


def test_no_sample_is_a_stride_through_a_list():
    """``firstfix.bit_exact.sample`` takes samples: a stride of a list repeats with the list's period."""
    packages = ("core/", "builder/", "service/", "clients/python/", "cli/", "plugins/", "lab/")
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


def test_no_page_denies_the_real_ros_that_the_tests_have():
    pages = [REPO / "README.md", *(REPO / "docs").rglob("*.md"), *(REPO / "clients").rglob("*.md")]
    denied = re.compile(
        r"\b(not|never)\b[^.|]{0,40}\b(run|tried|tested|yet)\b[^.|]{0,20}\breal ROS", re.IGNORECASE
    )
    assert denied.search("They have not run on a real ROS 2 yet")
    assert denied.search("not yet on a real ROS 2 system")
    assert (REPO / "tests/robots/test_real_ros.py").exists()
    assert not [page.name for page in pages if denied.search(page.read_text())]


def test_no_two_test_files_share_a_name():
    """Pytest imports them by their names alone, and only a run of both would show it."""
    names = Counter(path.name for path in (REPO / "tests").rglob("test_*.py"))
    assert not [name for name, count in names.items() if count > 1]

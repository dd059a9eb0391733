"""The locks pin and hash everything, and name no place to fetch it from."""

import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LOCKS = sorted((ROOT / "deploy" / "locks").glob("*.txt"))
CONSOLE = ROOT / "plugins/console/page/package-lock.json"
PINNED = re.compile(r"^[a-z0-9][a-z0-9._-]*(\[[a-z0-9,-]+\])?==[^ ]+( ;.*)? \\$", re.IGNORECASE)


def names(lock: Path) -> set[str]:
    return {line.split("==")[0] for line in lock.read_text().splitlines() if re.match(r"^[a-z0-9]", line)}


def test_the_locks_are_there():
    assert [lock.stem for lock in LOCKS] == [
        "builder",
        "dev",
        "ouster",
        "ros-jazzy",
        "ros-kilted",
        "service",
        "setup",
    ]


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.stem)
def test_a_lock_names_no_host(lock: Path):
    text = lock.read_text()
    assert "://" not in text
    assert "--index" not in text
    assert "--find-links" not in text


def test_the_console_lock_names_no_host_and_hashes_everything():
    text = CONSOLE.read_text()
    assert "://" not in text, "npm notes who funds a package: remove `funding`, and `resolved`"
    packages = json.loads(text)["packages"]
    assert all("integrity" in package for name, package in packages.items() if name)


@pytest.mark.parametrize("lock", LOCKS, ids=lambda lock: lock.stem)
def test_every_requirement_is_pinned_and_hashed(lock: Path):
    lines = [line for line in lock.read_text().splitlines() if not line.lstrip().startswith("#")]
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if not line.startswith(" "):
            assert PINNED.match(line), line
            assert following.startswith("    --hash=sha256:"), line


def test_the_service_image_has_no_mesh_tool():
    service = names(next(lock for lock in LOCKS if lock.stem == "service"))
    assert {"fastapi", "eclipse-zenoh", "faiss-cpu"} <= service
    assert not {name for name in service if name.startswith("open3d") or name in ("trimesh", "matplotlib")}


def test_the_images_run_the_versions_that_were_tested():
    pins = {lock.stem: set(re.findall(r"^[a-z0-9][^ ]*==[^ ]+", lock.read_text(), re.M)) for lock in LOCKS}
    assert pins["service"] <= pins["builder"] <= pins["dev"]

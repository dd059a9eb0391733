"""The way of a map: the files that are drawn, in a real service whose build runs in its sandbox."""

from __future__ import annotations

import json
import os
import re
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import httpx
import numpy as np
import pytest

from firstfix_builder.sandbox.kernel import SIGNALS_VERSION, landlock_version
from tests.changed_yard import write_cloud
from tests.servers import free_port, running
from tests.small_world import COARSE_CONFIG, SmallWorld
from tests.waiting import LIMIT_S, wait_until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        landlock_version() < SIGNALS_VERSION,
        reason="needs Landlock of version 6: run on Linux 6.12 or later",
    ),
]
FILE_LOG = Path(__file__).with_name("file_log") / "sitecustomize.py"
PAGE = Path(__file__).parents[2] / "docs/concepts/way-of-a-map.md"
SERVE = """
from firstfix_service.server import serve
from firstfix_service.settings import Settings
serve(Settings())
"""


def used_by_a_build(world: SmallWorld, folder: Path, log: Path) -> set[str]:
    """The files of the program that run from the service's start to the version's activation."""
    site = folder / "site"
    site.mkdir()
    shutil.copy(FILE_LOG, site)
    (site / "LOG").write_text(str(log))
    cloud, poses, port = write_cloud(world, folder / "yard.npy"), np.tile(np.eye(4), (40, 1, 1)), free_port()
    poses[:, 0, 3], poses[:, 2, 3] = np.linspace(-6.0, 6.0, len(poses)), 0.8
    environment = {
        "PYTHONPATH": os.pathsep.join([str(site), *filter(None, [os.environ.get("PYTHONPATH")])]),
        "FIRSTFIX_STORE": str(folder / "store"),
        "FIRSTFIX_PORT": str(port),
        "FIRSTFIX_CACHE_DIR": str(folder / "cache"),
        "FIRSTFIX_WORK_DIR": str(folder / "work"),
        "FIRSTFIX_RUN_BUILDS": "true",
        "FIRSTFIX_BUILD_SANDBOX": "required",
        "FIRSTFIX_POLL_INTERVAL_S": "3600",
        "FIRSTFIX_WORKERS": "1",
    }
    with running([sys.executable, "-c", SERVE], port, folder / "service.log", environment):
        url = f"http://127.0.0.1:{port}"
        wait_until(lambda: httpx.get(f"{url}/readyz", timeout=LIMIT_S).status_code == 200)
        files = {
            "source": (cloud.name, cloud.read_bytes()),
            "trajectory": ("poses.txt", "\n".join(" ".join(map(str, T[:3].ravel())) for T in poses)),
        }
        data = {"map_id": "yard", "config": json.dumps(COARSE_CONFIG)}
        answer = httpx.post(f"{url}/maps", data=data, files=files, timeout=LIMIT_S)
        assert answer.status_code == 202, answer.text
        build = f"{url}{answer.headers['Location']}"
        wait_until(lambda: httpx.get(build, timeout=LIMIT_S).json()["state"] in ("succeeded", "failed"))
        assert httpx.get(build, timeout=LIMIT_S).json()["state"] == "succeeded"
        return set(log.read_text().split())


def drawn_in(package: str) -> list[str]:
    """Files, and folders with a slash at the end, in the boxes from a package's name to the next one's."""
    drawing = PAGE.read_text().split("```")[1]
    boxes = re.split(r"names are paths in \w+/(\w+)", drawing)
    (text,) = (box for name, box in zip(boxes[1::2], boxes[2::2], strict=True) if name == package)
    names = re.findall(r"^ │ (\w+(?:/\w+)*/?) ", text, re.MULTILINE)
    return [f"{package}/{name}" if name.endswith("/") else f"{package}/{name}.py" for name in names]


def test_a_map_goes_through_the_files_that_are_drawn(small_world: SmallWorld, tmp_path: Path):
    with TemporaryDirectory(dir="/dev/shm") as shared:  # the sandbox may write there
        used = used_by_a_build(small_world, tmp_path, Path(shared) / "files.log")
    drawn = {package: drawn_in(package) for package in ("firstfix_service", "firstfix_builder", "firstfix")}
    for names in drawn.values():
        assert len(names) == len(set(names))
        assert {one for one in names if not any(file.startswith(one) for file in used)} == set(), "not used"
    service, builder = tuple(drawn["firstfix_service"]), tuple(drawn["firstfix_builder"])
    rooms = ("firstfix_builder/", "firstfix_service/builds/")
    others = {file for file in used if file.startswith(rooms)}
    assert {file for file in others if not file.startswith((*service, *builder))} == set(), "not drawn"

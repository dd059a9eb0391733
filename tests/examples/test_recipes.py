"""The commands of firstfix in the pages for ROS are executed, or the page says why not."""

from __future__ import annotations

import os
import random
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from itertools import cycle, islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.answer.localization import Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.catalog.catalog import Catalog
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix.transform import from_quaternion, inverse, transform_points
from firstfix_cli.local_service import local_service
from tests import ros_samples
from tests.dds_loopback import LOOPBACK
from tests.ros_samples import cloud_of_points, stores_of, write_bag
from tests.waiting import LIMIT_S, wait_until

HOW_TO = Path(__file__).resolve().parents[2] / "docs" / "how-to"
PAGES = {"bags.md": "", "ros.md": "\n## Recipes\n"}  # page -> where the commands begin that are executed
NOT_RUN = re.compile(r"^Not run here: \S.*\.$", re.M)
BLOCK = re.compile(r"(?P<before>[^\n]*)\n\n```sh\n(?P<text>.*?)^```", re.M | re.S)
S = 10**9
TURNED = from_quaternion([0.0, 0.0, 0.4], [1, 0, 0, 0])  # the LiDAR hangs upside down
FRONT, REAR = from_quaternion([0.3, 0, 0.5], [0, 0, 0, 1]), from_quaternion([-0.3, 0, 0.5], [0, 0, 1, 0])
PosedScan = tuple[Scan, NDArray[np.float64]]


def text_of(page: str) -> str:
    _, begun, rest = f"\n{(HOW_TO / page).read_text()}".partition(PAGES[page] or "\n")
    assert begun, f"{page} has no section {PAGES[page]!r}"
    return rest


def commands(page: str) -> list[str]:
    """The commands that are to be executed."""
    found = []
    for block in BLOCK.finditer(text_of(page)):
        if not NOT_RUN.match(block["before"]):
            found += [line for line in block["text"].replace("\\\n", " ").splitlines() if line]
    return found


COMMANDS = [(page, command) for page in PAGES for command in commands(page)]


@dataclass(frozen=True)
class Place:
    """A folder with the files that the pages name, and a service with the map."""

    folder: Path
    url: str
    store: Path

    def words(self, command: str) -> list[str]:
        program, *words = shlex.split(command)
        assert program == "firstfix", "other commands have a reason not to be run"
        here = {"http://localhost:8080": self.url, "s3://maps": str(self.store)}
        return [sys.executable, "-m", "firstfix_cli.main", *(here.get(word, word) for word in words)]


@pytest.fixture(scope="module")
def place(small_version, small_scans, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    root = tmp_path_factory.mktemp("recipes")
    store, folder = root / "store", root / "files"
    folder.mkdir()
    Catalog(Store.open(str(store))).publish("hall", small_version.directory, small_version.manifest)
    localizer = Localizer(MapIndex.load(small_version.directory))
    found = [pair for pair in small_scans if is_localized(localizer, pair[0])]
    drive = list(islice(cycle(found), 12))
    write_files(folder, drive, localizer)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(root / "cache"))
        with local_service(root / "service", store) as service:
            yield Place(folder, service.url, store)


def is_localized(localizer: Localizer, scan: Scan, **options: Any) -> bool:
    return localizer.localize(scan, LocalizeOptions(**options)).verdict is Verdict.LOCALIZED


def write_files(folder: Path, drive: list[PosedScan], localizer: Localizer) -> None:
    """Writes what the pages name: bags of one LiDAR, of two, with an IMU, and upside down."""
    bag = write_bag(folder, "mcap zstd message", bag_of(drive, {"/os/points": np.eye(4)}))
    bag.rename(folder / "drive-of-one")
    shutil.copy(next((folder / "drive-of-one").glob("*.mcap")), folder / "drive.mcap")
    two = write_bag(folder, "mcap zstd file", bag_of(drive, {"/front/points": FRONT, "/rear/points": REAR}))
    two.rename(folder / "drive")
    ros1 = bag_of(drive, {"/os/points": np.eye(4)}, kind="ros1", imu="/os/imu")
    write_bag(folder, "ros1 lz4", ros1).rename(folder / "drive.bag")
    hanging = bag_of(drive, {"/livox/lidar": TURNED}, imu="/livox/imu")
    bag = write_bag(folder, "mcap", hanging)
    shutil.copy(next(bag.glob("*.mcap")), folder / "mid360.mcap")
    down = np.array([0.0, 0.0, 1.0])
    turned = [transform_points(inverse(TURNED), scan.points).astype(np.float32) for scan, _ in drive]
    usable = (points for points in turned if is_localized(localizer, Scan(points), gravity=down))
    np.save(folder / "upside-down.npy", next(usable))


def bag_of(
    drive: list[PosedScan], lidars: dict[str, NDArray[np.float64]], *, kind: str = "mcap", imu: str = ""
) -> list[tuple[str, int, Any]]:
    """A drive with one scan a second, as LiDARs see it that are mounted so on a base at the scan's place."""
    stores = stores_of(kind)
    frames = {topic: topic.strip("/").replace("/", "_") for topic in lidars}
    mounted = [("base_link", frames[topic], T_base_lidar) for topic, T_base_lidar in lidars.items()]
    messages = [("/tf_static", S, ros_samples.transforms(mounted, stores=stores))]
    for number, (scan, T_map_base) in enumerate(drive, start=2):
        for topic, T_base_lidar in lidars.items():
            if imu:  # in g, at rest: it points up
                up = (T_map_base @ T_base_lidar)[2, :3]
                sample = ros_samples.imu(up, stores=stores, stamp_ns=number * S, frame_id=frames[topic])
                messages.append((imu, number * S, sample))
            seen = transform_points(inverse(T_base_lidar), scan.points)
            sent = cloud_of_points(seen, stores=stores, stamp_ns=number * S, frame_id=frames[topic])
            messages.append((topic, number * S, sent))
    return messages


@pytest.mark.slow
@pytest.mark.parametrize(("page", "command"), COMMANDS, ids=[f"{p}-{c[9:40]}" for p, c in COMMANDS])
def test_a_command_of_the_pages(place: Place, page: str, command: str):
    if "ros-gateway" in command:
        run_gateway(place, command)
        return
    done = subprocess.run(
        place.words(command), cwd=place.folder, capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "localized" in done.stdout


def run_gateway(place: Place, command: str) -> None:
    """Starts it, waits until it looks for robots, and ends it. Other tests have robots for it."""
    if "--dds" in command and find_spec("cyclonedds") is None:
        pytest.skip("needs cyclonedds: pip install './plugins/fleet[dds]'")
    domain = random.SystemRandom().randrange(1, 100)
    environment = {
        **os.environ,
        "CYCLONEDDS_URI": LOOPBACK,
        "ROS_DOMAIN_ID": str(domain),
        "PYTHONUNBUFFERED": "1",
    }
    out = place.folder / "gateway.log"
    with out.open("w") as log:
        gateway = subprocess.Popen(
            place.words(command), cwd=place.folder, env=environment, stdout=log, stderr=log
        )
    try:
        wait_until(lambda: "looking for robots" in out.read_text() or gateway.poll() is not None)
        assert gateway.poll() is None, out.read_text()
        gateway.send_signal(signal.SIGINT)
        assert gateway.wait(LIMIT_S) == 0, out.read_text()
    finally:
        gateway.kill()
        gateway.wait()
    if "--store" in command:
        assert "of map hall answers" in out.read_text()


def test_there_are_commands_to_run():
    assert len(COMMANDS) > 10
    assert {page for page, _ in COMMANDS} == set(PAGES)
    assert all(command.startswith("firstfix ") for _, command in COMMANDS)


def test_what_is_not_run_has_a_reason():
    text = text_of("ros.md")
    blocks = [block["before"] for block in BLOCK.finditer(text)]
    assert sum(bool(NOT_RUN.match(before)) for before in blocks) == len(NOT_RUN.findall(text)) == 5

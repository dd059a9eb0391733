"""Power cuts at random moments of uploads, builds and publications: is anything lost that was acknowledged?

    firstfix-lab power_cuts [--cuts 50] [--seed 0] [--json FILE]

A service with its store, work folder and cache on an ext4 image builds posted maps with
``tests.tiny_worker`` (all of the real path but the stages' work), while files are uploaded in parts
and versions are switched. At random moments the file system is shut down: what was written and not synced
is lost, as by a power cut. Then the image is mounted again, looked through, and the service is started on it.
It needs root, for it mounts the image. "Serving" is here that the service shows the active version and that
every file of every published version is whole: there is no index in them that could answer.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import random
import signal
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import httpx

from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError
from firstfix.store.store import Store
from tests.disk_image import DiskImage, why_no_images

from .kill_deployment import Deployment
from .power_cut_callers import MAPS, PART_BYTES, Acknowledged, Callers

IMAGE_BYTES = 16 << 30  # sparse: the service wants room on its disk
WAIT_S = 900.0  # for what takes seconds
MOMENTS = ("upload", "build", "publish", "any")


def power_cuts(folder: Path, *, cuts: int, seed: int = 0) -> dict[str, Any]:
    """The figures. ``lost``, ``torn``, ``broken``, ``not_serving`` and ``not_succeeded`` are to be empty.

    Args:
        folder: empty; of the image and where it is mounted.

    Raises:
        RuntimeError: no image can be mounted here.
    """
    if why := why_no_images():
        raise RuntimeError(why)
    rng = random.Random(seed)
    disk = DiskImage.make(folder / "image", folder / "disk", size_bytes=IMAGE_BYTES)
    said = Acknowledged()
    met: Counter[str] = Counter()
    found: dict[str, list[str]] = {"lost": [], "torn": [], "broken": [], "not_serving": []}
    began = time.monotonic()
    disk.mount()
    for number in range(cuts + 1):
        deployment = Deployment(disk.mount_point, None)
        deployment.start()
        try:
            found["not_serving"] += _not_serving(deployment)
            callers = Callers(deployment, said, rng.randrange(10**9))
            callers.start()
            try:
                if number == cuts:
                    _wait_until(lambda: bool(said.builds))
                    callers.hands_in = False
                    _wait_until(lambda: said.builds == said.succeeded.keys())
                else:
                    met[_wait_for_a_moment(disk, deployment, callers, rng)] += 1
                    disk.cut_power()
            finally:
                _end(deployment)
                callers.stop()
        finally:
            _unmount(disk)
        disk.mount()
        found["lost"] += [f"cut {number}: {what}" for what in said.missing_in(_catalog(disk))]
        found["torn"] += [f"cut {number}: {key}" for key in _torn(_catalog(disk).store)]
        found["broken"] += [f"cut {number}: {what}" for what in _broken(_catalog(disk), folder / "cache")]
    catalog = _catalog(disk)
    ended = {build_id: str(catalog.builds.status(build_id)["state"]) for build_id in sorted(said.builds)}
    versions = sum(len(catalog.state(map_id).published) for map_id in MAPS)
    _unmount(disk)
    return {
        "seed": seed,
        "seconds": round(time.monotonic() - began, 1),
        "cuts": dict(met),
        "builds_acknowledged": len(said.builds),
        "versions_published": versions,
        "switches_acknowledged": said.switches.total(),
        **found,
        "not_succeeded": {name: state for name, state in ended.items() if state != "succeeded"},
        "file_system_is_whole": disk.is_whole(),
    }


def _catalog(disk: DiskImage) -> Catalog:
    return Catalog(Store.open(f"file://{disk.mount_point / 'store'}"))


def _not_serving(deployment: Deployment) -> list[str]:
    """Contents of the store that a restarted service does not show."""
    http = httpx.Client(base_url=f"http://127.0.0.1:{deployment.port}", timeout=60.0)

    def is_there() -> bool:
        with suppress(httpx.HTTPError):
            return http.get("/readyz").status_code == 200 or http.get("/healthz").status_code == 200
        return False

    with http:
        if not _wait_until(is_there):
            return ["the service does not start"]
        catalog = Catalog(Store.open(deployment.store_url))

        def shown(map_id: str) -> str | None:
            return http.get(f"/maps/{map_id}").json().get("active_version")

        return [
            f"the active version of {name}"
            for name in catalog.map_ids()
            if is_another(partial(catalog.active_version, name), partial(shown, name))
        ]


def is_another(active: Callable[[], str | None], shown: Callable[[], str | None]) -> bool:
    """Whether another version than the active one is shown.

    A build that goes on after the cut may activate its version between the two looks. Then both look again.
    """
    while True:
        before, seen = active(), shown()
        if active() == before:
            return seen != before


def _torn(store: Store) -> list[str]:
    """Objects that differ from those put: empty ones, broken records, sources with another sha256.

    The files of versions are left to ``_broken``.
    """
    torn = []
    for item in store.scan():
        if item.key.endswith(("/cancel", "/log.txt")) or item.key.startswith("callers/"):  # may be empty
            continue
        if not item.size_bytes or (
            "/versions/" not in item.key and not _is_right(item.key, store.get(item.key))
        ):
            torn.append(item.key)
    return torn


def _is_right(key: str, content: bytes) -> bool:
    name = key.rsplit("/", 1)[-1]
    if name.endswith(".json"):
        try:
            json.loads(content)
        except ValueError:
            return False
    if "/sources/" in key:
        return hashlib.sha256(content).hexdigest() == name.split(".")[0]
    if key.startswith("uploads/") and "/parts/" in key:
        return content == content[:1] * PART_BYTES
    return True


def _broken(catalog: Catalog, cache: Path) -> list[str]:
    """Published versions of which a file is missing or differs."""
    broken = []
    for map_id in catalog.map_ids():
        for version in catalog.state(map_id).published:
            try:
                catalog.fetch_version(map_id, version, cache)
            except FirstfixError as error:
                broken.append(f"{map_id} {version[:12]}: {error}")
    return broken


def _wait_for_a_moment(disk: DiskImage, deployment: Deployment, callers: Callers, rng: random.Random) -> str:
    """Wait until a randomly chosen kind of work goes on, and a little longer. Returns its name."""
    moment = rng.choice(MOMENTS)
    if moment == "upload":
        _wait_until(lambda: callers.is_uploading)
        time.sleep(rng.uniform(0.0, 0.05))
    elif moment == "build":
        _wait_until(lambda: bool(deployment.members[0].build_pids()))
        time.sleep(rng.uniform(0.0, 4.0))
    elif moment == "publish":
        catalog = _catalog(disk)
        before = {map_id: _folders(catalog, map_id) for map_id in MAPS}
        _wait_until(lambda: any(_folders(catalog, map_id) != before[map_id] for map_id in MAPS))
        time.sleep(rng.uniform(0.0, 0.15))
    else:
        time.sleep(rng.uniform(0.0, 4.0))
    return moment


def _folders(catalog: Catalog, map_id: str) -> list[str]:
    return catalog.store.folders(f"maps/{map_id}/versions")


def _wait_until(condition: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + WAIT_S
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.005)
    return True


def _end(deployment: Deployment) -> None:
    """Kill the service and its builds, which are of sessions of their own."""
    for member in deployment.members:
        for pid in member.build_pids():
            with suppress(ProcessLookupError):
                os.killpg(pid, signal.SIGKILL)
        member.kill()


def _unmount(disk: DiskImage) -> None:
    """Unmounts the image as soon as no file on it is open."""

    def is_free() -> bool:
        with suppress(subprocess.CalledProcessError):
            disk.unmount()
            return True
        return False

    if not _wait_until(is_free):
        raise RuntimeError(f"somebody has a file open below {disk.mount_point}")


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab power_cuts", description=__doc__.split("\n\n")[0])
    parser.add_argument("--cuts", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        figures = power_cuts(Path(folder), cuts=chosen.cuts, seed=chosen.seed)
    text = json.dumps(figures, indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")
    wrong = ("lost", "torn", "broken", "not_serving", "not_succeeded")
    return int(any(figures[name] for name in wrong) or not figures["file_system_is_whole"])

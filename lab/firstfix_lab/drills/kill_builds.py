"""kill -9 at random moments of uploads, builds and publications: what is lost, half visible or left over.

    firstfix-lab kill_builds [--kills 50] [--queue embedded|nats] [--seed 0] [--json FILE]

A service, with NATS two workers beside it, builds one posted map after the other with
``tests.tiny_worker``: all of the real path but the stages' work. At random moments one of the
processes is killed, or a build's own, and started again. Meanwhile a reader verifies every version that
is active. In the end every build that the service took has to have succeeded, and after garbage
collection nothing may be in the store that nothing refers to.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from firstfix.builds.records import FINAL_STATES
from firstfix.builds.shared_stages import collect_stages
from firstfix.catalog.catalog import Catalog
from firstfix.errors import FirstfixError
from firstfix.store.store import Store
from tests.nats_server import NatsServer

from .kill_deployment import Deployment

END_S = 900.0
MAPS = ("hall", "yard")
MOMENT_S = 20.0  # at most, to wait for what a kill is to meet


class Reader:
    """Verifies every version that it sees active, as a replica does before it serves it."""

    def __init__(self, store_url: str, folder: Path) -> None:
        self._catalog = Catalog(Store.open(store_url))
        self._folder = folder
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self.verified: set[str] = set()
        self.broken: list[str] = []

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        self._stop.set()
        self._thread.join()

    def _read(self) -> None:
        while not self._stop.wait(0.02):
            for map_id in MAPS:
                version = self._catalog.active_version(map_id)
                if version is None or version in self.verified:
                    continue
                try:
                    self._catalog.fetch_version(map_id, version, self._folder)
                except FirstfixError as error:
                    self.broken.append(f"{map_id} {version[:12]}: {error}")
                self.verified.add(version)


def kill_builds(
    folder: Path, *, kills: int = 50, queue: str = "embedded", seed: int = 0, end_s: float = END_S
) -> dict[str, Any]:
    """The figures; all of ``not_succeeded``, ``broken``, ``published_twice`` and ``orphans`` are to be empty.

    Args:
        folder: empty; of the store, the work folders and the logs.
        queue: embedded or nats.
        end_s: for the builds to end after the last kill.
    """
    rng = random.Random(seed)
    server = NatsServer(folder / "nats") if queue == "nats" else None
    if server is not None:
        server.start()
    deployment = Deployment(folder, None if server is None else server.url)
    reader = Reader(deployment.store_url, folder / "reader")
    catalog = Catalog(Store.open(deployment.store_url))
    posted: list[str] = []
    killed: Counter[str] = Counter()
    began = time.monotonic()
    try:
        deployment.start()
        reader.start()
        seeds = iter(range(10**9))
        while killed.total() < kills:
            while sum(_state(catalog, build_id) not in FINAL_STATES for build_id in posted) < 3:
                poster = threading.Thread(target=_post, args=(deployment, posted, next(seeds)))
                poster.start()
                if rng.random() < 0.1:  # a kill that meets the upload
                    time.sleep(rng.uniform(0.0, 0.1))
                    killed[_kill_one(deployment, rng)] += 1
                poster.join()
            _wait_for_a_moment(deployment, catalog, rng)
            killed[_kill_one(deployment, rng)] += 1
        open_builds = list(posted)
        deadline = time.monotonic() + end_s
        while open_builds and time.monotonic() < deadline:
            open_builds = [b for b in _recorded(catalog) if _state(catalog, b) not in FINAL_STATES]
            time.sleep(0.2)
        time.sleep(0.2)
    finally:
        deployment.stop()
        if server is not None:
            server.stop(signal.SIGKILL)
        reader.stop()
    return {
        "queue": queue,
        "seed": seed,
        "seconds": round(time.monotonic() - began, 1),
        "kills": dict(killed),
        "builds_taken": len(posted),
        "builds_on_record": len(_recorded(catalog)),
        "attempts": sum(_attempts(catalog, build_id) for build_id in _recorded(catalog)),
        "versions_verified": len(reader.verified),
        "not_succeeded": {b: s for b in _recorded(catalog) if (s := _state(catalog, b)) != "succeeded"}
        | {b: "lost" for b in posted if b not in _recorded(catalog)},
        "broken": reader.broken,
        "published_twice": _published_twice(catalog),
        "left_before_gc": len(_orphans(catalog)),
        "orphans": _after_gc(catalog),
    }


def _post(deployment: Deployment, posted: list[str], seed: int) -> None:
    build_id = deployment.post(MAPS[seed % len(MAPS)], seed)
    if build_id is None:  # the service is starting
        time.sleep(0.3)
    else:
        posted.append(build_id)


def _wait_for_a_moment(deployment: Deployment, catalog: Catalog, rng: random.Random) -> None:
    """Wait for a random moment of one of three kinds.

    A third of them is while a version's files are being put, most others are while a build runs: processes
    take longer to start than that.
    """
    kind = rng.random()
    if kind < 0.33:
        _wait_until(lambda: _is_publishing(deployment, catalog))
        time.sleep(rng.uniform(0.0, 0.1))
    elif kind < 0.9:
        _wait_until(lambda: any(member.build_pids() for member in deployment.members))
        time.sleep(rng.uniform(0.0, 2.0))
    else:
        time.sleep(rng.uniform(0.0, 2.0))


def _wait_until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + MOMENT_S
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.005)


def _is_publishing(deployment: Deployment, catalog: Catalog) -> bool:
    """Whether somebody works on a version that has files and is not published yet."""
    if not any(member.build_pids() for member in deployment.members):
        return False
    return any(
        catalog.store.folders(f"maps/{map_id}/versions")[len(catalog.state(map_id).published) :]
        for map_id in MAPS
    )


def _kill_one(deployment: Deployment, rng: random.Random) -> str:
    """Kill a member, which is started again, or the build that one runs. What was killed."""
    at_work = [member for member in deployment.members if member.build_pids()]
    member = rng.choice(at_work if at_work and rng.random() < 0.7 else deployment.members)
    builds = member.build_pids()
    if builds and rng.random() < 0.5:
        with suppress(ProcessLookupError):  # ended this moment
            os.kill(rng.choice(builds), signal.SIGKILL)
        return "build"
    member.kill()
    member.start()
    return member.name


def _recorded(catalog: Catalog) -> list[str]:
    """Ids of the builds with a record. A kill while it is written leaves a folder without one."""
    return [one for one in catalog.builds.ids() if catalog.store.exists(f"builds/{one}/request.json")]


def _state(catalog: Catalog, build_id: str) -> str:
    return str(catalog.builds.status(build_id)["state"])


def _attempts(catalog: Catalog, build_id: str) -> int:
    keys = catalog.store.list(f"builds/{build_id}/attempts")
    return sum(1 for key in keys if key.rsplit("/", 1)[-1].count(".") == 1 and key.endswith(".json"))


def _published_twice(catalog: Catalog) -> list[str]:
    """Build that left more than one entry of a kind in their map's log."""
    seen = Counter(
        f"{e.build_id} {e.event.value}" for map_id in catalog.map_ids() for e in catalog.log(map_id)
    )
    return sorted(entry for entry, times in seen.items() if times > 1)


def _orphans(catalog: Catalog) -> list[str]:
    """Files of the store that no version, no build and no log refers to."""
    store = catalog.store
    referred = {str(catalog.builds.request(b)["source"]["key"]) for b in _recorded(catalog)}
    kept = {key for folder in ("changes", "checked", "callers") for key in store.list(folder)}
    for map_id in catalog.map_ids():
        for version in catalog.state(map_id).published:
            folder = f"maps/{map_id}/versions/{version}"
            names = catalog.manifest(map_id, version).files
            kept |= {f"{folder}/manifest.json", *(f"{folder}/{name}" for name in names)}
        kept |= {*store.list(f"maps/{map_id}/log"), *store.list(f"maps/{map_id}/snapshots")}
    builds = set(store.list("builds"))
    root = store.local_path(f"builds/{_recorded(catalog)[0]}/request.json")
    assert root is not None
    root = root.parents[2]
    on_disk = {path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file()}
    return sorted(on_disk - referred - kept - builds)


def _after_gc(catalog: Catalog) -> list[str]:
    """The objects that nothing refers to after garbage collection.

    Uploads of unrecorded builds are left out: they are the map's sources, and are kept.
    """
    for map_id in MAPS:
        catalog.collect_garbage(map_id, older_than_s=0)
    collect_stages(catalog.store, 0)
    catalog.store.remove_leftovers(older_than_s=0)
    return [key for key in _orphans(catalog) if "/sources/" not in key]


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab kill_builds", description=__doc__.split("\n\n")[0])
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--queue", choices=("embedded", "nats"), default="embedded")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        figures = kill_builds(Path(folder), kills=chosen.kills, queue=chosen.queue, seed=chosen.seed)
    text = json.dumps(figures, indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")
    wrong = ("not_succeeded", "broken", "published_twice", "orphans")
    return int(any(figures[name] for name in wrong))

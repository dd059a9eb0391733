"""Every end of a build, in every stage: the store then holds what the answers said, and nothing more.

    firstfix-lab ends [--only END ...] [--python PATH] [--json FILE]

A service builds one map after the other with ``tests.tiny_worker``: all of the real path but the
stages' work, with a provisional version. Each build meets one event in one stage. Then it must end as the
event demands, and everything in the store must be referred to: by the record of a build, or by a version in
service. With ``--python`` the interpreter of another checkout runs the
service and the builds. The disks that become full are tmpfs, which needs root.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from firstfix.builds.records import FINAL_STATES
from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from tests.tiny_worker import STAGES
from tests.waiting import wait_until

from .kill_deployment import Deployment, Member

LIMIT_S = 120.0  # for a build to end, or a service to start
DISK_BYTES = 512 << 20  # holds the versions of all builds that succeed
MEMORY_BYTES = 400 << 20
LARGE_FILE_BYTES, LEFT_BYTES = 4 << 20, 8 << 20  # a version has four files: they do not fit into what is left


@dataclass
class World:
    """A service, its store and the build that is tried.

    Attributes:
        until: the build hangs until this file exists.
        wrong: what was found that should not be, by the end that was tried.
    """

    folder: Path
    deployment: Deployment
    until: Path
    tried: int = 0
    wrong: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))

    @property
    def catalog(self) -> Catalog:
        return Catalog(Store.open(self.deployment.store_url))

    @property
    def service(self) -> Member:
        return self.deployment.members[0]

    def status(self, build_id: str) -> dict[str, Any]:
        return self.catalog.builds.status(build_id)

    def cancel(self, build_id: str) -> None:
        httpx.delete(f"http://127.0.0.1:{self.deployment.port}/builds/{build_id}", timeout=30)

    def restart(self) -> None:
        self.service.start()
        wait(self.answers, "the service answers")

    def answers(self) -> bool:
        with suppress(httpx.HTTPError):
            return httpx.get(f"http://127.0.0.1:{self.deployment.port}/readyz", timeout=5).is_success
        return False


def cancel(world: World, build_id: str) -> str:
    """A caller ends it."""
    world.cancel(build_id)
    return "cancelled"


def kill_build(world: World, build_id: str) -> str:
    """Its process is killed, once: it runs again and succeeds."""
    for pid in world.service.build_pids():
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    world.until.touch()
    return "succeeded"


def kill_service(world: World, build_id: str) -> str:
    """The service is killed: its successor runs the build again."""
    world.service.kill()
    world.until.touch()
    world.restart()
    return "succeeded"


def restart_service(world: World, build_id: str) -> str:
    """The service is stopped in good order."""
    assert world.service.process is not None
    world.service.process.terminate()
    world.service.process.wait()
    world.until.touch()
    world.restart()
    return "succeeded"


def cancel_and_kill(world: World, build_id: str) -> str:
    """The service is killed just after it took the cancellation."""
    world.cancel(build_id)
    world.service.kill()
    world.restart()
    return "cancelled"


def let_go(world: World, build_id: str) -> str:
    world.until.touch()
    return "succeeded"


def goes_wrong(world: World, build_id: str) -> str:
    """The build does by itself what it was told."""
    return "failed"


@contextmanager
def _disk_filled(folder: Path) -> Iterator[None]:
    """Leave a disk ``LEFT_BYTES`` while the block runs."""
    ballast = folder / "ballast"
    free = os.statvfs(folder).f_bavail * os.statvfs(folder).f_frsize
    ballast.write_bytes(bytes(max(free - LEFT_BYTES, 0)))
    try:
        yield
    finally:
        ballast.unlink()


def store_full_for_a_while(world: World, build_id: str) -> str:
    """The store has no room for the version, and then it has."""
    with _disk_filled(world.folder / "store"):
        world.until.touch()
        wait(lambda: (world.status(build_id)["error"] or {}).get("code") == "out_of_space", "it says why")
    return "succeeded"


@dataclass(frozen=True)
class End:
    """One kind of end.

    Attributes:
        act: makes it happen once the build is in the stage. Returns the state in which the build must end.
        told: what the build is told, with STAGE for the stage.
        stages: in which it is tried.
        wants_disks: store and work folder are to be small disks.
    """

    act: Callable[[World, str], str]
    told: dict[str, Any]
    stages: tuple[str, ...] = STAGES
    wants_disks: bool = False

    @property
    def hangs(self) -> bool:
        return "hang_in" in self.told


_HANG = {"hang_in": "STAGE"}
ENDS = {
    "succeed": End(let_go, _HANG),
    "cancel": End(cancel, _HANG),
    "cancel a deaf stage": End(cancel, {**_HANG, "deaf": True}, STAGES[:2]),
    "cancel and kill the service": End(cancel_and_kill, _HANG),
    "cancel in the queue": End(cancel, {}, ("queued",)),
    "fail": End(goes_wrong, {"fail_in": "STAGE"}),
    "kill the build": End(kill_build, _HANG),
    "kill the service": End(kill_service, _HANG),
    "restart the service": End(restart_service, _HANG),
    "too much memory": End(goes_wrong, {"grow_in": "STAGE"}),
    "store full for a while": End(
        store_full_for_a_while, {**_HANG, "file_bytes": LARGE_FILE_BYTES}, STAGES[-1:], wants_disks=True
    ),
}


def ends(
    folder: Path,
    names: Sequence[str] = tuple(ENDS),
    *,
    python: str = sys.executable,
    say: Callable[[str], None],
) -> dict[str, Any]:
    """Try each end in each of its stages. ``wrong`` of the figures is to be empty.

    Args:
        folder: empty; of the store, the work folders and the logs.
        say: told each end that was tried.
    """
    chosen = {name: ENDS[name] for name in names}
    with _disks(folder, wanted=any(end.wants_disks for end in chosen.values())):
        deployment = Deployment(
            folder,
            None,
            python=python,
            variables={"FIRSTFIX_BUILD_MAX_MEMORY_BYTES": str(MEMORY_BYTES)},
            constants={"min_free_bytes": 0},
        )
        world = World(folder, deployment, folder / "go")
        deployment.start()
        try:
            wait(world.answers, "the service answers")
            for name, end in chosen.items():
                for stage in end.stages:
                    _try(world, name, end, stage)
                    case = f"{name} in {stage}"
                    say(f"{case}: {'; '.join(world.wrong.get(case, ['as it should']))}")
        except AssertionError:
            say(world.service.log.read_text()[-4000:])
            raise
        finally:
            deployment.stop()
    return {"tried": world.tried, "wrong": dict(world.wrong)}


def _try(world: World, name: str, end: End, stage: str) -> None:
    world.tried += 1
    world.until.unlink(missing_ok=True)
    case, map_id = f"{name} in {stage}", f"m{world.tried}"
    told = {key: stage if value == "STAGE" else value for key, value in end.told.items()}
    first = None
    if stage == "queued":
        first = world.deployment.post(
            f"{map_id}-first", world.tried, hang_in=STAGES[0], until=str(world.until)
        )
    build_id = world.deployment.post(map_id, 1000 + world.tried, early=True, until=str(world.until), **told)
    assert build_id is not None
    if end.hangs:
        wait(lambda: world.status(build_id)["stage"] == stage, f"{case}: the stage begins")
    expected = end.act(world, build_id)
    wait(lambda: world.status(build_id)["state"] in FINAL_STATES, f"{case}: the build ends")
    world.until.touch()
    if first is not None:
        wait(lambda: world.status(first)["state"] in FINAL_STATES, f"{case}: the build before ends")
    wait(lambda: not world.service.build_pids(), f"{case}: no process is left")
    wrong = world.wrong[case]
    status = world.status(build_id)
    if status["state"] != expected:
        wrong.append(f"it {status['state']} ({status['error']}), not {expected}")
    if world.catalog.active_version(map_id) != status["version"]:
        wrong.append("a version is active that the status does not name")
    # what is removed after the end is on record
    left: list[str] = []

    def is_clean() -> bool:
        left[:] = left_over(world)
        return not left

    with suppress(AssertionError):
        wait(is_clean, "nothing is left", limit_s=60.0)
    if left:
        wrong.append(f"{len(left)} objects are left, as {left[0]}")
        _forget(world, left)
    if not wrong:
        del world.wrong[case]


def left_over(world: World) -> list[str]:
    """Objects of the store that no record of a build, no version in service and no log refers to."""
    catalog = world.catalog
    store = catalog.store
    keys = store.list()  # before the references: what is created meanwhile is not taken for left over
    referred: set[str] = set()
    for build_id in catalog.builds.ids():
        referred.update(store.list(f"builds/{build_id}"))
        if catalog.builds.status(build_id)["state"] not in ("failed", "cancelled"):
            referred.add(str(catalog.builds.request(build_id)["source"]["key"]))
    for map_id in catalog.folder_names():
        for version in catalog.state(map_id).published:
            names = (*catalog.manifest(map_id, version).files, "manifest.json")
            referred.update(f"maps/{map_id}/versions/{version}/{name}" for name in names)
        referred.update(store.list(f"maps/{map_id}/log"))
        referred.update(store.list(f"maps/{map_id}/snapshots"))
    # of retired versions: garbage collection removes them after a day
    retired = tuple(
        f"maps/{map_id}/versions/{entry.version}/"
        for map_id in catalog.folder_names()
        for entry in catalog.log(map_id)
        if entry.version not in catalog.state(map_id).published
    )
    kept = ("changes/", "callers/", "checked/", *retired)
    return sorted(key for key in keys if key not in referred and not key.startswith(kept))


def _forget(world: World, left: Sequence[str]) -> None:
    """Remove what is left, so that the next end is not blamed for it."""
    for key in left:
        world.catalog.store.delete(key)


def wait(condition: Callable[[], object], what: str, limit_s: float = LIMIT_S) -> None:
    wait_until(condition, limit_s, what)


@contextmanager
def _disks(folder: Path, *, wanted: bool) -> Iterator[None]:
    """Put the store on a small disk of its own."""
    store = folder / "store"
    store.mkdir()
    if not wanted:
        yield
        return
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_BYTES}", "tmpfs", str(store)], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", str(store)], check=True)


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab ends", description=__doc__.split("\n\n")[0])
    parser.add_argument("--only", nargs="+", choices=tuple(ENDS), default=tuple(ENDS), metavar="END")
    parser.add_argument("--python", default=sys.executable, metavar="PATH", help="interpreter of a checkout")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the figures here")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        figures = ends(
            Path(folder), chosen.only, python=chosen.python, say=lambda text: print(text, flush=True)
        )
    text = json.dumps(figures, indent=1)
    print(text)
    if chosen.json:
        chosen.json.write_text(text + "\n")
    return int(bool(figures["wrong"]))

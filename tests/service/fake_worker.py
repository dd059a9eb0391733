"""Fake of firstfix_builder.worker on the real store: the sensor name in its config says what it does."""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from firstfix.builds.records import new_status
from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store


def hang(tied_to_stdin: bool) -> None:
    """Waits until it is killed, or until its stdin is closed."""
    if tied_to_stdin:
        sys.stdin.read()
        os._exit(75)
    while True:
        signal.pause()


def main() -> int:
    parser = argparse.ArgumentParser()
    for name in ("--store", "--build", "--work"):
        parser.add_argument(name, required=True)
    for name in ("--tied-to-stdin", "--share-stages"):
        parser.add_argument(name, action="store_true")
    parser.add_argument("--source-url", action="append", default=[])
    chosen = parser.parse_args()
    catalog = Catalog(Store.open(chosen.store))
    request = catalog.builds.request(chosen.build)
    map_id, do = request["map_id"], request["config"].get("sensor", {}).get("name", "succeed")
    work = Path(chosen.work)
    with (work / "order.txt").open("a") as file:
        file.write(f"{map_id} {os.getpriority(os.PRIO_PROCESS, 0)} {os.getpid()}\n")
    (work / "source_urls.txt").write_text(" ".join(chosen.source_url))
    catalog.builds.set_status(
        chosen.build, new_status("running", map_id=map_id, stage="describe", progress=0.5)
    )
    if do == "die":
        print("something to say\nthe reason it died", file=sys.stderr)
        return 1
    if do == "killed":
        os.kill(os.getpid(), signal.SIGKILL)
    if do == "killed_once" and not (work / "was_killed").exists():
        (work / "was_killed").touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if do == "again" and not (work / "came_again").exists():
        (work / "came_again").touch()
        return 75
    if do == "hang_once" and not (work / "hung").exists():
        (work / "hung").touch()
        hang(chosen.tied_to_stdin)
    if do == "hang_with_a_child":
        child = subprocess.Popen(["sleep", "600"])
        (work / "child.txt").write_text(str(child.pid))
        os.kill(os.getpid(), signal.SIGSTOP)  # ignores every signal but SIGKILL
    if do == "work_for_ever":
        for number in range(10**9):
            progress = 0.5 + number % 1000 / 2000
            status = new_status("running", map_id=map_id, stage="describe", progress=progress)
            catalog.builds.set_status(chosen.build, status)
            time.sleep(0.05)
    if do == "hang_thrice" and len((work / "order.txt").read_text().splitlines()) <= 3:
        sys.stdin.read()
        return 75
    if do == "no_space":
        print("the store's disk needs 9 bytes for x: 3 bytes are free", file=sys.stderr)
        return 73
    if do == "allocate_600_mib":
        data = bytearray(600 << 20)
        data[::4096] = b"x" * len(data[::4096])
        hang(chosen.tied_to_stdin)
    if do == "until_cancelled":
        while not catalog.builds.is_cancel_requested(chosen.build):
            time.sleep(0.05)
        catalog.builds.set_status(chosen.build, new_status("cancelled", map_id=map_id, stage="describe"))
        return 3
    catalog.builds.set_status(
        chosen.build,
        new_status("succeeded", map_id=map_id, stage="publish", progress=1.0, version="a" * 64),
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())

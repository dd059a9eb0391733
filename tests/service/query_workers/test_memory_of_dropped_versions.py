"""A worker process gives the memory of versions back when they are dropped."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from firstfix_service.query_workers.handle import QueryWorkerHandle
from firstfix_service.query_workers.query import ServedVersion

VERSIONS = 48


def held_mb(worker: QueryWorkerHandle) -> float:
    """Memory of its own: pages of the versions' files, which processes share, do not count."""
    status = Path(f"/proc/{worker.pid}/status").read_text()
    return int(status.split("RssAnon:")[1].split()[0]) / 1024


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's allocator")
def test_versions_that_are_dropped_leave_little_behind(small_version):
    def named(number: int) -> ServedVersion:
        return ServedVersion(f"map-{number}", f"{number:064x}", small_version.directory)

    worker = QueryWorkerHandle(30.0, 1 << 20, counts_sightings=False)
    try:
        worker.wait_until_up()
        worker.load(named(0))  # imports what a version needs
        worker.drop(named(0))
        before_mb = held_mb(worker)
        for number in range(VERSIONS):
            worker.load(named(number))
        loaded_mb = held_mb(worker) - before_mb
        for number in range(VERSIONS):
            worker.drop(named(number))
        left_mb = held_mb(worker) - before_mb
    finally:
        worker.kill()
        worker.wait()
        worker.close()
    assert loaded_mb > 10
    assert left_mb < loaded_mb / 2

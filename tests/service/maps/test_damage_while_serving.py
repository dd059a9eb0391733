"""Files that are damaged after a version was loaded: the answer says so, and the version before serves."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from firstfix.errors import FirstfixError, WorkerLost
from tests.service.service_world import Service, publish, running_service
from tests.waiting import wait_until


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    with running_service(tmp_path, zenoh=False) as service:
        yield service


def damage(service: Service, tmp_path: Path, version: str) -> None:
    """One wrong bit, with the times of the right file: bits rot without a trace."""
    path = tmp_path / "store" / "maps" / "hall" / "versions" / version / "label.txt"
    times = path.stat()
    path.write_text(chr(ord(path.read_text()[0]) ^ 1) + path.read_text()[1:])
    os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))


@pytest.mark.parametrize("error", [IndexError("out of bounds"), WorkerLost("two worker processes died")])
def test_a_query_that_fails_on_a_damaged_file_says_so(service: Service, tmp_path: Path, error: Exception):
    first = publish(service.catalog, "hall", "1", service.scratch)
    second = publish(service.catalog, "hall", "2", service.scratch)
    assert first != second
    wait_until(lambda: service.ask_http().x == 2)
    damage(service, tmp_path, second)
    assert service.ask_http().x == 2, "it is in memory, and nobody has looked"
    service.behaviour.raises = error
    reply = service.ask_http()
    assert reply.json["code"] == "corrupt_version"
    assert "label.txt" in reply.json["detail"]
    service.behaviour.raises = None
    assert service.ask_http().x == 1, "the version before"


def test_a_query_that_fails_on_right_files_is_told_as_before(service: Service):
    publish(service.catalog, "hall", "1", service.scratch)
    for error, code in (
        (IndexError("a defect"), FirstfixError.code),
        (WorkerLost("two worker processes died"), WorkerLost.code),
    ):
        service.behaviour.raises = error
        assert service.ask_http().json["code"] == code
    service.behaviour.raises = None
    assert service.ask_http().x == 1
    assert service.behaviour.loads == ["1"], "it stays in memory"

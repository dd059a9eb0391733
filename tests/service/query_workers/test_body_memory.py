"""Memory through which bodies reach a worker: on its own, and with real workers that are killed over it."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

from firstfix.errors import TooLarge
from firstfix_service.query_workers.protocol import KEPT_BYTES, BodyMemory, mapped_bodies

pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="needs Linux, which has files in memory: run in a container"
)
CAPACITY = 16 << 20


@pytest.fixture
def memory():
    memory = BodyMemory(CAPACITY)
    yield memory
    memory.close()


def held_bytes(memory: BodyMemory) -> int:
    return os.fstat(memory.descriptor).st_blocks * 512


def test_the_worker_sees_what_was_written_and_cannot_write(memory: BodyMemory):
    seen = mapped_bodies(memory.descriptor, CAPACITY)
    memory.write(b"a body")
    assert seen[:6] == b"a body"
    memory.write(memoryview(b"more"))
    assert seen[:4] == b"more"
    with pytest.raises(TypeError):
        seen[0] = 0


def test_a_body_over_the_capacity_is_refused(memory: BodyMemory):
    with pytest.raises(TooLarge):
        memory.write(bytes(CAPACITY + 1))


def test_only_what_was_written_takes_memory_and_a_large_body_gives_its_own_back(memory: BodyMemory):
    assert held_bytes(memory) == 0
    memory.write(bytes(100_000))
    assert 0 < held_bytes(memory) < 200_000
    memory.trim(100_000)
    memory.write(bytes(CAPACITY))
    assert held_bytes(memory) == CAPACITY
    memory.trim(CAPACITY)
    assert held_bytes(memory) == KEPT_BYTES


def test_nobody_can_change_the_files_size(memory: BodyMemory):
    """Otherwise a worker could take away the pages that the service writes to."""
    other = os.open(f"/proc/self/fd/{memory.descriptor}", os.O_RDWR)
    try:
        for size in (0, 2 * CAPACITY):
            with pytest.raises(PermissionError):
                os.truncate(f"/proc/self/fd/{other}", size)
    finally:
        os.close(other)


def test_closing_leaves_no_file_and_no_mapping():
    before = _bodies_mapped()
    memory = BodyMemory(CAPACITY)
    assert _bodies_mapped() == before + 1
    number = memory.descriptor
    memory.close()
    assert _bodies_mapped() == before
    assert not Path(f"/proc/self/fd/{number}").exists()


def _bodies_mapped() -> int:
    return Path("/proc/self/maps").read_text().count("firstfix-bodies")

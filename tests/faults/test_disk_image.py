"""The image of a disk, whose power is cut, as other tests use it."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.faults.disk_image import DiskImage, why_no_images
from tests.waiting import wait_until

SIZE_BYTES = 16 << 20
HOLD_S = 1


def test_power_is_back_though_a_container_held_the_mount(tmp_path: Path):
    """A process with mounts of its own has a copy of this mount until it ends."""
    if why := why_no_images():
        pytest.skip(why)
    disk = DiskImage.make(tmp_path / "image", tmp_path / "at", size_bytes=SIZE_BYTES)
    disk.mount()
    (disk.mount_point / "kept").write_bytes(b"kept")
    os.sync()
    own_mounts = ("unshare", "--mount", "--propagation", "private")
    with subprocess.Popen([*own_mounts, "sleep", str(HOLD_S)]) as container:
        wait_until(lambda: mounts_of(container.pid) != mounts_of(os.getpid()))
        disk.cut_power()
        disk.unmount()
        with disk:
            assert (disk.mount_point / "kept").read_bytes() == b"kept"


def mounts_of(pid: int) -> str:
    return str(Path(f"/proc/{pid}/ns/mnt").readlink())

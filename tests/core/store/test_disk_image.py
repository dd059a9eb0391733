"""The image of a disk, whose power is cut, as other tests use it."""

from __future__ import annotations

import os
import subprocess
import threading
from pathlib import Path

import pytest

from tests.disk_image import DiskImage, why_no_images
from tests.waiting import let_pass, wait_until

SIZE_BYTES = 16 << 20
HOLD_S = 0.5


def test_power_is_back_though_a_container_held_the_mount(tmp_path: Path):
    """A process with mounts of its own has a copy of this mount until it ends.

    It ended by its own clock, on a busy machine before its mounts were looked at. Now it ends once the disk
    is unmounted here.
    """
    if why := why_no_images():
        pytest.skip(why)
    disk = DiskImage.make(tmp_path / "image", tmp_path / "at", size_bytes=SIZE_BYTES)
    disk.mount()
    (disk.mount_point / "kept").write_bytes(b"kept")
    os.sync()
    own_mounts = ("unshare", "--mount", "--propagation", "private")
    with subprocess.Popen([*own_mounts, "cat"], stdin=subprocess.PIPE) as container:

        def end_it() -> None:
            wait_until(lambda: str(disk.mount_point) not in Path("/proc/self/mounts").read_text())
            let_pass(HOLD_S)
            container.communicate()

        wait_until(lambda: mounts_of(container.pid) != mounts_of(os.getpid()))
        disk.cut_power()
        ending = threading.Thread(target=end_it)
        ending.start()
        disk.unmount()
        with disk:
            assert (disk.mount_point / "kept").read_bytes() == b"kept"
        ending.join()


def mounts_of(pid: int) -> str:
    return str(Path(f"/proc/{pid}/ns/mnt").readlink())

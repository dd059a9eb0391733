"""A real file system in an image file, whose power can be cut: an ext4 on a loop device."""

from __future__ import annotations

import array
import fcntl
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from tests.needs import needs
from tests.waiting import wait_until

_EXT4_IOC_SHUTDOWN = 0x8004587D  # linux: _IOR('X', 125, __u32)
_NO_LOG_FLUSH = 2  # nothing more is written, also nothing of the journal
_MIN_BYTES = 8 << 20
_BYTES_PER_FILE = 1 << 16  # so that a large image is made soon


class DiskImage:
    """An ext4 file system, mounted while it is used as a context manager.

    What programs have written and not synced is in memory for a while, as on any disk: ``copy_to`` and
    ``cut_power`` show what is on the disk at that moment. The disk itself is taken to keep what it was
    given: a disk that forgets what was not flushed is not simulated.
    """

    def __init__(self, image: Path, mount_point: Path) -> None:
        self.image = image
        self.mount_point = mount_point

    @classmethod
    def make(cls, image: Path, mount_point: Path, *, size_bytes: int) -> DiskImage:
        """A new, empty file system in a sparse file."""
        with image.open("wb") as file:
            file.truncate(size_bytes)
        _run("mkfs.ext4", "-q", "-F", "-i", str(_BYTES_PER_FILE), str(image))
        return cls(image, mount_point)

    def mount(self) -> None:
        """Applies the journal, as a start after a power cut does."""
        self.mount_point.mkdir(parents=True, exist_ok=True)
        # The journal is written each second: names come to disk well before the bytes of young files.
        _run("mount", "-o", "loop,commit=1", str(self.image), str(self.mount_point))

    def unmount(self) -> None:
        """Returns when the kernel has let go of the file system.

        A process that is born meanwhile with mounts of its own, as a container, holds a copy of this mount
        for a moment. Who mounts the image in that moment gets the same file system again, without power.
        """
        _run("umount", str(self.mount_point))
        wait_until(lambda: not self._is_held(), what=f"nobody holds {self.mount_point}")

    def _is_held(self) -> bool:
        return bool(_run("losetup", "--associated", str(self.image)))

    def __enter__(self) -> DiskImage:
        self.mount()
        return self

    def __exit__(self, *_: object) -> None:
        self.unmount()

    def copy_to(self, image: Path, mount_point: Path) -> DiskImage:
        """A copy of what is on the disk now. Nobody may write meanwhile."""
        shutil.copyfile(self.image, image)
        return DiskImage(image, mount_point)

    def cut_power(self) -> None:
        """From now on nothing reaches the disk, and programs that write get errors."""
        handle = os.open(self.mount_point, os.O_RDONLY)
        try:
            fcntl.ioctl(handle, _EXT4_IOC_SHUTDOWN, array.array("I", [_NO_LOG_FLUSH]))
        finally:
            os.close(handle)

    def is_whole(self) -> bool:
        """Returns whether fsck finds the file system sound. It must not be mounted."""
        return subprocess.run(["e2fsck", "-f", "-n", str(self.image)], capture_output=True).returncode == 0


def why_no_images() -> str | None:
    """The reason why this process cannot make and mount images; None if it can."""
    for program in ("mkfs.ext4", "e2fsck", "mount", "umount", "losetup"):
        if shutil.which(program) is None:
            return needs(program, "apt-get install e2fsprogs mount")
    with tempfile.TemporaryDirectory() as folder:
        try:
            with DiskImage.make(Path(folder) / "image", Path(folder) / "at", size_bytes=_MIN_BYTES):
                return None
        except subprocess.CalledProcessError as error:
            why = error.stderr.decode(errors="replace").strip()[:200]
            return f"needs root and loop devices, so that an image can be mounted: {why}"


def _run(*command: str) -> bytes:
    return subprocess.run(command, check=True, capture_output=True).stdout

"""Arrays in new files: a full disk is an error, not the end of the process."""

from __future__ import annotations

import errno
import os
from tempfile import TemporaryFile

import numpy as np
import pytest

from firstfix.errors import OutOfSpace
from firstfix_builder.mesh import mapped_array as module
from firstfix_builder.mesh.mapped_array import mapped_array, mapped_scratch


def test_the_room_is_taken_before_anything_is_written(tmp_path):
    array = mapped_array(tmp_path / "a.npy", np.float64, (100_000, 3))
    assert (tmp_path / "a.npy").stat().st_blocks * 512 >= array.nbytes
    array[-1] = 7
    array.flush()
    np.testing.assert_array_equal(np.load(tmp_path / "a.npy")[-2:], [[0, 0, 0], [7, 7, 7]])


def test_a_file_without_a_name(tmp_path):
    with TemporaryFile(dir=tmp_path) as file:
        array = mapped_scratch(file, np.float32, (1000, 8))
        assert os.fstat(file.fileno()).st_blocks * 512 >= array.nbytes
    array[:] = 1
    assert array.sum() == 8000


def test_an_empty_array(tmp_path):
    assert mapped_array(tmp_path / "a.npy", np.float64, (0, 3)).shape == (0, 3)


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_named_with_its_figures(tmp_path, monkeypatch, code):
    def full(*given):
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(module.os, "posix_fallocate", full)
    with pytest.raises(OutOfSpace, match=r"work disk is full: 2400128 bytes .* and [0-9]+ bytes are left"):
        mapped_array(tmp_path / "a.npy", np.float64, (100_000, 3))


def test_a_disk_that_cannot_take_room(tmp_path, monkeypatch):
    def unsupported(*given):
        raise OSError(errno.EOPNOTSUPP, "no")

    monkeypatch.setattr(module.os, "posix_fallocate", unsupported)
    assert len(mapped_array(tmp_path / "a.npy", np.float64, (10, 3))) == 10


@pytest.mark.skipif(not os.access("/", os.W_OK), reason="needs root, who mounts a small disk: sudo make test")
def test_a_disk_that_is_really_full(tmp_path):
    """Ended the process with SIGBUS where the room was not taken. Needs the right to mount."""
    small = tmp_path / "small"
    small.mkdir()
    if os.system(f"mount -t tmpfs -o size=1m none {small} 2>/dev/null"):
        pytest.skip("needs the right to mount a small disk: run as root outside of a container")
    try:
        with pytest.raises(OutOfSpace, match="work disk is full"):
            mapped_array(small / "a.npy", np.float64, (100_000, 3))
    finally:
        os.system(f"umount {small}")

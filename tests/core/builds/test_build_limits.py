"""Limits of builds where nobody has set others."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from firstfix.builds.limits import default_build_memory_bytes, memory_bytes

MACHINE = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def cgroups(folder: Path, files: dict[str, str], of_this_process: str) -> tuple[Path, Path]:
    for name, content in files.items():
        path = folder / "cgroup" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content)
    (folder / "self").write_text(of_this_process)
    return folder / "cgroup", folder / "self"


@pytest.mark.parametrize(
    ("files", "of_this_process", "found"),
    [
        ({"memory.max": "1000\n"}, "0::/\n", 1000),
        ({"memory.max": "max\n"}, "0::/\n", MACHINE),
        ({"memory.max": str(1 << 62)}, "0::/\n", MACHINE),
        ({"a/b/memory.max": "3000", "a/memory.max": "2000"}, "0::/a/b\n", 2000),
        ({"a/memory.max": "2000"}, "0::/elsewhere\n", MACHINE),
        ({"memory/memory.limit_in_bytes": "5000\n"}, "4:memory:/docker/1\n", 5000),
        ({}, "", MACHINE),
    ],
)
def test_the_memory_is_that_of_the_machine_or_of_the_container(
    tmp_path: Path, files: dict[str, str], of_this_process: str, found: int
):
    assert memory_bytes(*cgroups(tmp_path, files, of_this_process)) == found


def test_a_machine_without_cgroups(tmp_path: Path):
    assert memory_bytes(tmp_path / "none", tmp_path / "none") == MACHINE


def test_a_build_may_take_half():
    assert default_build_memory_bytes() == memory_bytes() // 2

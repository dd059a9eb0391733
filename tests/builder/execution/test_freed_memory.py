"""What a build frees is the machine's again, though small blocks between the large ones stay."""

import subprocess
import sys

import pytest

BLOCKS = """
import sys
from pathlib import Path
from firstfix_builder.execution.freed_memory import return_large_blocks

if sys.argv[1] == "returned":
    return_large_blocks()
bytearray(30 << 20)  # freed: by itself, glibc now takes all blocks up to this size from its heap
large, small = [], []
for _ in range(50):
    large.append(bytearray(b"1") * (5 << 20))
    small.append(bytearray(b"1") * 100_000)
large.clear()
held = Path("/proc/self/smaps_rollup").read_text().split("Anonymous:")[1]
print(held.split()[0])
"""


def held_mb(how: str) -> float:
    return int(subprocess.check_output([sys.executable, "-c", BLOCKS, how])) / 1024


@pytest.mark.skipif(sys.platform != "linux", reason="glibc's allocator")
def test_large_blocks_are_returned_once_they_are_freed():
    assert held_mb("kept") - held_mb("returned") > 150

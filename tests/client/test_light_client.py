"""What a robot has to install: numpy, httpx and zstandard, and what these bring."""

from __future__ import annotations

import subprocess
import sys

CODE = """
import sys
import firstfix_client
heavy = ["scipy", "faiss", "small_gicp", "pydantic", "zenoh", "fastapi", "open3d", "obstore"]
print(sorted(set(heavy) & set(sys.modules)))
"""


def test_the_client_imports_nothing_heavy():
    found = subprocess.run([sys.executable, "-c", CODE], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"

"""Imports that few processes of a kind need come late: they would be a third of the start of each of them."""

import subprocess
import sys

import pytest

PROCESSES = {
    "firstfix_service.server": ("scipy", "matplotlib", "open3d"),
    "firstfix_service.query_workers.worker": ("scipy", "fastapi", "httpx", "zenoh"),
    "firstfix_builder.worker": ("scipy", "faiss", "httpx"),
    "firstfix_builder.pipeline": ("scipy.stats", "matplotlib.pyplot", "open3d"),
    "firstfix_cli.main": ("scipy", "faiss", "fastapi", "httpx", "numpy"),
}


@pytest.mark.parametrize("module", PROCESSES)
def test_a_process_starts_without_what_it_seldom_runs(module: str):
    code = f"import sys, {module}; print(*sys.modules)"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert set(PROCESSES[module]) & set(said.split()) == set()

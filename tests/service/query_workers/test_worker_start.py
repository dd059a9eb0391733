"""A query worker starts without SciPy, whose import would take half of its start."""

from __future__ import annotations

import subprocess
import sys

from tests.waiting import LIMIT_S


def test_a_query_worker_starts_without_scipy():
    code = "import sys, firstfix_service.query_workers.worker; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=LIMIT_S)
    assert done.returncode == 0, done.stderr
    packages = {name.partition(".")[0] for name in done.stdout.split()}
    assert {"firstfix", "faiss"} <= packages
    assert "scipy" not in packages

"""A gateway that asks a service loads no engine: robots have little memory."""

from __future__ import annotations

import subprocess
import sys

from tests.waiting import LIMIT_S

WITHOUT_STORE = """
import sys
from firstfix_cli.answerer import answerer
from firstfix_fleet.commands import ros_gateway
from firstfix_fleet.rmw_zenoh import fleet, robot

def tell(line):
    raise AssertionError(line)

with answerer("hall", url="http://127.0.0.1:9", zenoh=None, store=None, timeout_s=1, follow=tell):
    pass
heavy = {"faiss", "open3d", "scipy", "obstore", "firstfix.engine", "firstfix_builder"}
print(sorted(heavy & set(sys.modules)))
"""


def test_without_a_store_the_gateway_carries_no_engine():
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_STORE], capture_output=True, text=True, timeout=LIMIT_S, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[]"

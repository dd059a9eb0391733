"""No two tests of a machine have one port or one DDS domain."""

from __future__ import annotations

import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.claimed import any_domain, free_port
from waiting import LIMIT_S

ROOT = Path(__file__).resolve().parents[2]
ALL_DOMAINS = """
import sys
import pytest

from tests.claimed import any_domain
try:
    while True:
        print(any_domain())
except RuntimeError:
    print("none", flush=True)
sys.stdin.read()
"""


def test_a_port_is_given_once_and_not_by_the_kernel():
    ports = [free_port() for _ in range(200)]
    assert len(set(ports)) == 200
    low, _ = map(int, Path("/proc/sys/net/ipv4/ip_local_port_range").read_text().split())
    assert max(ports) < low


def test_a_port_that_another_program_has_is_passed_over(monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = other.getsockname()[1]
        monkeypatch.setattr("tests.claimed._PORTS", range(taken, taken + 1))
        with pytest.raises(RuntimeError, match="too many runs"):
            free_port()


def test_what_another_process_has_is_passed_over_until_it_ends():
    own = any_domain()
    command = [sys.executable, "-c", ALL_DOMAINS]
    with subprocess.Popen(
        command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as other:
        its = [line.strip() for line in iter(other.stdout.readline, "none\n")]
        assert str(own) not in its
        other.communicate(timeout=LIMIT_S)
    assert any_domain() != own

"""DDS on loopback alone, and a robot's program on it."""

from __future__ import annotations

import fcntl
import json
import os
import random
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import IO, Any

from tests.dds_loopback import LOOPBACK
from waiting import LIMIT_S, wait_until

HERE = Path(__file__).resolve().parent

_DOMAINS = list(range(1, 100))  # above 100 their ports are those of short connections
random.SystemRandom().shuffle(_DOMAINS)
_TAKEN: list[IO[bytes]] = []  # locks of this process's domains


def any_domain() -> int:
    """A domain that no test of this machine has: a participant may outlive its test."""
    while True:
        domain = _DOMAINS.pop()
        lock = (Path(tempfile.gettempdir()) / f"firstfix-dds-domain-{domain}.lock").open("wb")
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            lock.close()
            continue
        _TAKEN.append(lock)
        return domain


class RobotProgram:
    """A running ``dds_robot``."""

    def __init__(self, domain: int, namespace: str = "", *, best_effort: bool = False) -> None:
        arguments = {
            "domain": domain,
            "config": LOOPBACK,
            "namespace": namespace,
            "best_effort": best_effort,
        }
        path = os.pathsep.join([str(HERE), str(HERE.parent), *sys.path])
        self.program = subprocess.Popen(
            [sys.executable, str(HERE / "dds_robot.py"), json.dumps(arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": path},
        )
        self.heard: list[dict[str, Any]] = []
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()

    def _listen(self) -> None:
        assert self.program.stdout is not None
        for line in self.program.stdout:
            self.heard.append(json.loads(line))

    def tell(self, **command: Any) -> None:
        assert self.program.stdin is not None
        self.program.stdin.write(json.dumps(command) + "\n")
        self.program.stdin.flush()

    def of(self, topic: str) -> list[dict[str, Any]]:
        return [one for one in list(self.heard) if one["topic"] == topic]

    def wait_for(self, topic: str, count: int = 1) -> list[dict[str, Any]]:
        wait_until(lambda: len(self.of(topic)) >= count or self.program.poll() is not None)
        assert self.program.poll() is None, "the robot's program ended"
        return self.of(topic)

    def stop(self) -> None:
        assert self.program.stdin is not None
        self.program.stdin.close()
        self.program.wait(LIMIT_S)
        self._thread.join(LIMIT_S)

"""DDS on loopback alone, and a robot's program on it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from tests.dds_loopback import LOOPBACK
from tests.waiting import LIMIT_S, wait_until

HERE = Path(__file__).resolve().parent


class RobotProgram:
    """A running ``dds_robot``."""

    def __init__(
        self, domain: int, namespace: str = "", *, best_effort: bool = False, form: str = "plain"
    ) -> None:
        arguments = {
            "domain": domain,
            "config": LOOPBACK,
            "namespace": namespace,
            "best_effort": best_effort,
            "form": form,
        }
        path = os.pathsep.join(sys.path)
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

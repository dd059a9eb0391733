"""A local service for the demo and the benchmarks."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx

from firstfix.errors import FirstfixError

START_S = 300.0  # on a busy machine; usually five


@dataclass(frozen=True)
class LocalService:
    """Addresses of a running service.

    Attributes:
        url: URL for HTTP clients.
        zenoh: endpoint for zenoh clients.
        log: file with its output.
    """

    url: str
    zenoh: str
    log: Path


@contextmanager
def local_service(directory: Path, store: Path) -> Iterator[LocalService]:
    """Runs ``firstfix serve`` in its own process, on free ports of the loopback interface.

    Args:
        directory: folder for its zenoh configuration, log and build cache.

    Raises:
        FirstfixError: it does not start; the log says why.
    """
    directory.mkdir(parents=True, exist_ok=True)
    service = LocalService(
        f"http://127.0.0.1:{_free_port()}", f"tcp/127.0.0.1:{_free_port()}", directory / "service.log"
    )
    config = directory / "zenoh.json5"
    settings = {"listen": {"endpoints": [service.zenoh]}, "scouting": {"multicast": {"enabled": False}}}
    config.write_text(json.dumps(settings))
    command = [sys.executable, "-m", "firstfix_cli.main", "serve", "--store", str(store)]
    command += [
        "--port",
        service.url.rpartition(":")[2],
        "--zenoh",
        str(config),
        "--work",
        str(directory / "work"),
    ]
    with service.log.open("w") as log:
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)
        try:
            _wait(service, process)
            yield service
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _wait(service: LocalService, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline and process.poll() is None:
        try:
            if httpx.get(f"{service.url}/readyz", timeout=2.0).is_success:
                return
        except httpx.TransportError:
            pass
        time.sleep(0.1)
    raise FirstfixError(f"the service did not start, see {service.log}")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port

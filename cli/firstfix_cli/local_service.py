"""A local service for the demo and the benchmarks."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx

from firstfix.errors import FirstfixError

from .free_port import free_port

START_S = 300.0  # on a busy machine; usually five


@dataclass(frozen=True)
class LocalService:
    """Addresses of a running service.

    Attributes:
        url: URL for HTTP clients.
        zenoh: endpoint for zenoh clients.
        log: file with its output.
        process: of the service.
    """

    url: str
    zenoh: str
    log: Path
    process: subprocess.Popen[bytes]


@contextmanager
def local_service(directory: Path, store: Path, port: int = 0) -> Iterator[LocalService]:
    """Run ``firstfix serve`` in its own process, on the loopback interface.

    Args:
        directory: folder for its zenoh configuration, log and build cache.
        port: for HTTP, if it is free; else any free port.

    Raises:
        FirstfixError: it does not start; the log says why.
    """
    directory.mkdir(parents=True, exist_ok=True)
    port, zenoh, log = free_port(port), f"tcp/127.0.0.1:{free_port()}", directory / "service.log"
    config = directory / "zenoh.json5"
    settings = {"listen": {"endpoints": [zenoh]}, "scouting": {"multicast": {"enabled": False}}}
    config.write_text(json.dumps(settings))
    command = [sys.executable, "-m", "firstfix_cli.main", "serve", "--store", str(store)]
    command += ["--port", str(port), "--zenoh", str(config), "--work", str(directory / "work")]
    with log.open("w") as output:
        process = subprocess.Popen(command, stdout=output, stderr=subprocess.STDOUT)
        service = LocalService(f"http://127.0.0.1:{port}", zenoh, log, process)
        try:
            _wait(service)
            yield service
        finally:
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _wait(service: LocalService) -> None:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline and service.process.poll() is None:
        try:
            if httpx.get(f"{service.url}/readyz", timeout=2.0).is_success:
                return
        except httpx.TransportError:
            pass
        time.sleep(0.1)
    raise FirstfixError(f"the service did not start, see {service.log}")

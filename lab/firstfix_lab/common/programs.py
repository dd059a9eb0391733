"""The processes of a deployment on this machine, each for as long as a block lasts."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import httpx

from firstfix_cli.free_port import free_port

START_S = 300.0
BUCKET = "maps"


def missing(*programs: str) -> str | None:
    """A message that names missing programs, or None if all are installed."""
    absent = [name for name in programs if shutil.which(name) is None]
    return f"no {', '.join(absent)} here (`make all-test-servers`)" if absent else None


@contextmanager
def program(command: list[str], log: Path, environment: Mapping[str, str] | None = None) -> Iterator[None]:
    with log.open("ab") as out:
        process = subprocess.Popen(command, stdout=out, stderr=out, env={**os.environ, **(environment or {})})
        try:
            yield
        finally:
            process.kill()
            process.wait()


def wait_for_port(port: int, log: Path) -> None:
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return
        except OSError:
            time.sleep(0.05)
    raise RuntimeError(f"nothing listens on {port}: see {log}")


@contextmanager
def s3_server(directory: Path) -> Iterator[tuple[int, dict[str, str]]]:
    """Its port, and the environment that its clients need. It has one empty bucket, ``BUCKET``."""
    (directory / "objects" / BUCKET).mkdir(parents=True)
    port, access, secret = free_port(), secrets.token_hex(8), secrets.token_hex(16)
    command = ["versitygw", "--port", f"127.0.0.1:{port}", "--quiet", "posix", str(directory / "objects")]
    own = {"ROOT_ACCESS_KEY": access, "ROOT_SECRET_KEY": secret}
    with program(command, directory / "s3.log", own):
        wait_for_port(port, directory / "s3.log")
        yield port, {"AWS_ACCESS_KEY_ID": access, "AWS_SECRET_ACCESS_KEY": secret}


class Cable:
    """A TCP connection that can be cut: a proxy of toxiproxy."""

    def __init__(self, api: str, port: int) -> None:
        self._api = api
        self.port = port

    def cut(self) -> None:
        httpx.post(f"{self._api}/proxies/cable", json={"enabled": False}).raise_for_status()

    def mend(self) -> None:
        httpx.post(f"{self._api}/proxies/cable", json={"enabled": True}).raise_for_status()


@contextmanager
def cable_to(port: int, directory: Path) -> Iterator[Cable]:
    control, own = free_port(), free_port()
    log = directory / "toxiproxy.log"
    with program(["toxiproxy-server", "-host", "127.0.0.1", "-port", str(control)], log):
        wait_for_port(control, log)
        api = f"http://127.0.0.1:{control}"
        described = {"name": "cable", "listen": f"127.0.0.1:{own}", "upstream": f"127.0.0.1:{port}"}
        httpx.post(f"{api}/proxies", json=described).raise_for_status()
        yield Cable(api, own)


class Replica:
    """One ``firstfix serve``, stopped and started at will.

    Args:
        command: in its place.
        environment: of the process, beside this one's.
    """

    def __init__(
        self,
        directory: Path,
        settings: Mapping[str, object],
        command: Sequence[str] | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self.port = free_port()
        self.url = f"http://{settings.get('host', '127.0.0.1')}:{self.port}"
        listens = settings.get("zenoh_listen")
        self.endpoint = str(listens[0]) if isinstance(listens, list) else ""
        self.log = directory / "service.log"
        given = {"port": self.port, "work_dir": directory / "work", "cache_dir": directory / "cache"}
        named = {f"FIRSTFIX_{name.upper()}": _text(value) for name, value in {**given, **settings}.items()}
        self._environment = {**os.environ, **named, **(environment or {})}
        self._command = command or [sys.executable, "-m", "firstfix_cli.main", "serve"]
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def pid(self) -> int:
        assert self._process is not None
        return self._process.pid

    def start(self) -> Replica:
        with self.log.open("ab") as out:
            self._process = subprocess.Popen(self._command, stdout=out, stderr=out, env=self._environment)
        return self

    def wait_until_ready(self) -> None:
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline:
            try:
                if httpx.get(f"{self.url}/readyz", timeout=2.0).is_success:
                    return
            except httpx.TransportError:
                pass
            time.sleep(0.1)
        raise RuntimeError(f"the service did not start: see {self.log}")

    def end(self, number: signal.Signals = signal.SIGTERM) -> None:
        if self._process is not None:
            self._process.send_signal(number)
            try:
                self._process.wait(40)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None


@contextmanager
def replica(directory: Path, **settings: object) -> Iterator[Replica]:
    one = Replica(directory, settings).start()
    try:
        one.wait_until_ready()
        yield one
    finally:
        one.end()


def _text(value: object) -> str:
    return json.dumps(value) if isinstance(value, (list, tuple, bool)) else str(value)

"""Real servers for the tests, as programs of this machine: found, started, waited for, ended."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.claimed import free_port as free_port
from tests.needs import needs
from tests.waiting import wait_until


def program(name: str, how_to_get_it: str) -> str:
    """The path of a program; without it the test is skipped and says how to get it."""
    go_bin = os.environ.get("GOBIN") or str(Path(os.environ.get("GOPATH") or Path.home() / "go") / "bin")
    found = shutil.which(name) or shutil.which(name, path=go_bin) or shutil.which(name, path="/usr/sbin")
    if found is None:
        pytest.skip(needs(name, how_to_get_it))
    return found


def _listens(port: int) -> bool:
    try:
        socket.create_connection(("127.0.0.1", port), timeout=1).close()
    except OSError:
        return False
    return True


@contextmanager
def running(
    command: list[str], port: int, log: Path, environment: Mapping[str, str] | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """A server that listens on a port of loopback; it is killed at the end."""
    with log.open("ab") as out:
        server = subprocess.Popen(
            command, env={**os.environ, **(environment or {})}, cwd=log.parent, stdout=out, stderr=out
        )
    try:
        wait_until(lambda: server.poll() is not None or _listens(port), what=f"{command[0]}, {log}")
        if server.poll() is not None:
            pytest.fail(f"{command[0]} did not start: {log.read_text()[-1000:]}")
        yield server
    finally:
        server.kill()
        server.wait()


@contextmanager
def running_versitygw(
    folder: Path, port: int, access: str, secret: str, *options: str
) -> Iterator[subprocess.Popen[bytes]]:
    """An S3 server over ``folder/data``, whose subfolders are buckets."""
    name = program("versitygw", "make test-servers builds it, with Go")
    command = [name, "--port", f"127.0.0.1:{port}", "--quiet", *options, "posix", str(folder / "data")]
    environment = {"ROOT_ACCESS_KEY": access, "ROOT_SECRET_KEY": secret}
    with running(command, port, folder / "log", environment) as server:
        yield server


@contextmanager
def running_mosquitto(folder: Path, port: int, *lines: str) -> Iterator[subprocess.Popen[bytes]]:
    """An MQTT broker with the given lines of configuration; without any, everybody may do everything."""
    name = program("mosquitto", "make test-servers installs it, for root")
    config = folder / f"mosquitto-{port}.conf"
    config.write_text("\n".join([f"listener {port} 127.0.0.1", *(lines or ["allow_anonymous true"])]) + "\n")
    with running([name, "-c", str(config)], port, folder / "mosquitto.log") as server:
        yield server

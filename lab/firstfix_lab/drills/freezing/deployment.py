"""The deployment of the drill: a service with its object store, NATS, build workers and a zenoh router."""

from __future__ import annotations

import json
import os
import secrets
import shutil
import signal
import sys
import time
import uuid
from contextlib import ExitStack
from pathlib import Path
from unittest.mock import patch

import httpx

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from firstfix_lab.checkout import ROOT
from tests.claimed import free_port
from tests.nats_server import nats_server_program

from ...common.programs import BUCKET
from .http_reader import http_reader
from .part import BY_ROUTER, OF_STORE, Effect, Part
from .processes import Member, command_of, marked_with, send, tree_of
from .query_worker import QueryWorker
from .server_part import ServerPart
from .yard import Yard, publish_yard
from .zenoh_peer import zenoh_peer

MARK = "FIRSTFIX_FROZEN_DRILL"
PATCHED_CLI = ROOT / "tests" / "patched_cli.py"
CONSTANTS = {
    "min_free_bytes": 0,
    "build_attempts": 1000,
    "max_open_uploads": 10_000,  # those that failed stay open
    "max_open_uploads_per_caller": 10_000,
}
START_S = 200.0
ENDS_S = 20.0  # for the children of a killed process to see that it is gone
WORKERS = 2
BUILD_WORKERS = 2
_ROUTER = """
import json, sys, time, zenoh
config = {"mode": "router", "listen": {"endpoints": [sys.argv[1]]},
          "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}}}
session = zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
time.sleep(86400)
"""


class Deployment:
    """All processes, and the parts among them that can be frozen.

    Args:
        folder: empty; of the store, the caches and the logs.
        root: checkout whose service and build workers run; the other processes are the same for each.
        readers: connections of the HTTP reader, which asks for 4 MB on each.
    """

    def __init__(self, folder: Path, root: Path, readers: int) -> None:
        self._folder, self._root, self._readers = folder, root, readers
        self._ports = {name: free_port() for name in ("store", "nats", "router", "zenoh", "http")}
        self.url = f"http://127.0.0.1:{self._ports['http']}"
        self.endpoint = f"tcp/127.0.0.1:{self._ports['zenoh']}"
        self.router_endpoint = f"tcp/127.0.0.1:{self._ports['router']}"
        self._mark = uuid.uuid4().hex
        self._credentials = {
            "AWS_ACCESS_KEY_ID": secrets.token_hex(8),
            "AWS_SECRET_ACCESS_KEY": secrets.token_hex(16),
        }
        self._stack = ExitStack()
        self.service = self._member("service", [*self._python, str(PATCHED_CLI), "serve"])
        self.parts: dict[str, Part] = {}
        self.deaths = 0

    def start(self) -> Yard:
        """Start everything; returns the map that is served."""
        self._stack.enter_context(patch.dict(os.environ, self._credentials))
        for part in (self._store_part(), self._nats_part(), self._router_part(), *self._build_workers()):
            self._add(part)
        yard = publish_yard(Catalog(Store.open(self.store_url)), self._folder)
        os.environ[MARK] = self._mark  # for the strangers, which are children of this process
        self._stack.callback(os.environ.pop, MARK)
        query = self._folder / "query.xyz"
        query.write_bytes(yard.query.content)
        self._stack.callback(self.service.kill)
        self.service.start()
        self.wait_until_ready()
        self._add(QueryWorker(lambda: tree_of(self.service.pid)))
        self._add(zenoh_peer(self.endpoint, str(query)))
        self._add(http_reader(self._ports["http"], yard.cloud_path, self._readers))
        return yard

    def stop(self) -> list[str]:
        """Ends everything; returns the commands of processes that would have been left, now killed."""
        self.service.thaw()
        send([self.service.pid], signal.SIGTERM)
        deadline = time.monotonic() + START_S
        while not self.service.has_ended and time.monotonic() < deadline:
            time.sleep(0.05)
        self._stack.close()
        deadline = time.monotonic() + ENDS_S
        while (left := self._left()) and time.monotonic() < deadline:
            time.sleep(0.05)
        commands = [command for pid in left if (command := command_of(pid))]
        send(left, signal.SIGKILL)
        return commands

    def _left(self) -> list[int]:
        return [pid for pid in marked_with(MARK, self._mark) if pid != os.getpid()]

    def watch_over(self) -> None:
        """Start the service again if it has ended, as an orchestrator does."""
        if self.service.has_ended:
            self.deaths += 1
            self.service.start()

    def restart(self) -> None:
        """Start the service anew: for one that does not come back."""
        self.service.kill()
        self.service.start()
        self.wait_until_ready()

    def wait_until_ready(self) -> None:
        deadline = time.monotonic() + START_S
        while time.monotonic() < deadline and not self.service.has_ended:
            try:
                if httpx.get(f"{self.url}/readyz", timeout=2.0).is_success:
                    return
            except httpx.TransportError:
                pass
            time.sleep(0.1)
        raise RuntimeError(f"the service did not start: see {self.service.log}")

    @property
    def store_url(self) -> str:
        server = f"http://127.0.0.1:{self._ports['store']}"
        return f"s3://{BUCKET}/drill?endpoint={server}&region=us-east-1&allow_http=true"

    @property
    def _python(self) -> list[str]:
        own = self._root / ".venv" / "bin" / "python"
        return [str(own if own.exists() else sys.executable)]

    def _add(self, part: Part) -> None:
        self._stack.callback(part.kill)
        part.start()
        self.parts[part.name] = part

    def _member(self, name: str, command: list[str], **settings: object) -> Member:
        folder = self._folder / name
        given = {
            "store": self.store_url,
            "port": self._ports["http"],
            "work_dir": folder / "work",
            "cache_dir": folder / "cache",
            "workers": WORKERS,
            "poll_interval_s": 0.5,
            "zenoh": "true",
            "zenoh_listen": json.dumps([self.endpoint]),
            "zenoh_connect": json.dumps([self.router_endpoint]),
            "build_queue": f"nats://127.0.0.1:{self._ports['nats']}",
            "build_command": json.dumps([*self._python, "-m", "tests.tiny_worker"]),
            "build_lease_s": 3.0,
            "log_level": "warning",
            **settings,
        }
        variables = {f"FIRSTFIX_{key.upper()}": str(value) for key, value in given.items()}
        variables |= {MARK: self._mark, "CONSTANTS": json.dumps(CONSTANTS), **self._credentials}
        return Member(command, variables, self._folder / f"{name}.log", self._root)

    def _store_part(self) -> Part:
        data = self._folder / "objects"
        (data / BUCKET).mkdir(parents=True)
        port = self._ports["store"]
        own = {
            "ROOT_ACCESS_KEY": self._credentials["AWS_ACCESS_KEY_ID"],
            "ROOT_SECRET_KEY": self._credentials["AWS_SECRET_ACCESS_KEY"],
            MARK: self._mark,
        }
        program = shutil.which("versitygw") or "versitygw"
        command = [program, "--port", f"127.0.0.1:{port}", "--quiet", "posix", str(data)]
        member = Member(command, own, self._folder / "store.log", data)
        # Who waits for a turn behind others that wait for the store is refused after a while. A caller has
        # only so many uploads at a time.
        unavailable = frozenset({"store_unavailable", "overloaded", "quota_exceeded"})
        return ServerPart("object store", member, port, Effect(dict.fromkeys(OF_STORE, unavailable)))

    def _nats_part(self) -> Part:
        program, port = nats_server_program() or "nats-server", self._ports["nats"]
        command = [program, "-a", "127.0.0.1", "-p", str(port), "-js", "-sd", str(self._folder / "nats")]
        member = Member(command, {MARK: self._mark}, self._folder / "nats.log")
        return ServerPart("NATS", member, port, Effect())

    def _router_part(self) -> Part:
        command = [sys.executable, "-c", _ROUTER, self.router_endpoint]
        member = Member(command, {MARK: self._mark}, self._folder / "router.log")
        # Who asks by a router that does not answer hears nothing.
        return ServerPart(
            "zenoh router", member, self._ports["router"], Effect({BY_ROUTER: frozenset({"no reply"})})
        )

    def _build_workers(self) -> list[Part]:
        """Several; one of them can be frozen."""
        found: list[Part] = []
        for number in range(BUILD_WORKERS):
            name = "build worker" if number == 0 else f"build worker {number}"
            command = [*self._python, str(PATCHED_CLI), "worker"]
            command += ["--work", str(self._folder / name), "--health-port", str(free_port())]
            found.append(ServerPart(name, self._member(name, command), None, Effect()))
        return found

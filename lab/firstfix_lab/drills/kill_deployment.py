"""A service and its workers as processes to be killed: what ``firstfix_lab.drills.kill_builds`` kills."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx

from firstfix_lab.checkout import ROOT
from tests.claimed import free_port
from tests.tiny_worker import config_telling

LEASE_S = 2.0
STAGE_S = 0.1
PATCHED_CLI = ROOT / "tests" / "patched_cli.py"


@dataclass
class Member:
    """One process of the deployment, that is started again when it was killed."""

    name: str
    command: list[str]
    environment: dict[str, str]
    log: Path
    process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        with self.log.open("ab") as log:
            self.process = subprocess.Popen(
                self.command, env=self.environment, stdout=log, stderr=log, start_new_session=True
            )

    def kill(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()

    def build_pids(self) -> list[int]:
        """The builds that it runs; its query workers are none."""
        assert self.process is not None
        found = []
        for folder in Path("/proc").glob("[0-9]*"):
            with suppress(OSError, IndexError):  # ended meanwhile
                # After the name, which may hold anything: state, parent.
                fields = (folder / "stat").read_text().rpartition(")")[2].split()
                is_build = b"tests.tiny_worker" in (folder / "cmdline").read_bytes()
                if int(fields[1]) == self.process.pid and fields[0] != "Z" and is_build:
                    found.append(int(folder.name))
        return found


@dataclass
class Deployment:
    """The members in one folder.

    Attributes:
        python: interpreter of the checkout that is tried.
        variables: further variables of the members' environment.
    """

    folder: Path
    nats_url: str | None
    python: str = sys.executable
    variables: dict[str, str] = field(default_factory=dict)
    # the kills are ours, not the builds'
    constants: dict[str, int] = field(default_factory=lambda: {"build_attempts": 1000})
    members: list[Member] = field(default_factory=list)
    port: int = field(default_factory=free_port)

    @property
    def store_url(self) -> str:
        return f"file://{self.folder / 'store'}"

    def start(self) -> None:
        environment = {
            **os.environ,
            "FIRSTFIX_STORE": self.store_url,
            "FIRSTFIX_PORT": str(self.port),
            "FIRSTFIX_BUILD_QUEUE": self.nats_url or "embedded",
            "FIRSTFIX_RUN_BUILDS": "true",
            "FIRSTFIX_BUILD_COMMAND": json.dumps([self.python, "-m", "tests.tiny_worker"]),
            "FIRSTFIX_BUILD_LEASE_S": str(LEASE_S),
            "CONSTANTS": json.dumps(self.constants),
            "FIRSTFIX_CACHE_DIR": str(self.folder / "cache"),
            **self.variables,
        }
        roles = ["serve", *(["worker", "worker"] if self.nats_url else [])]
        for i, role in enumerate(roles):
            work = self.folder / f"work{i}"
            command = [self.python, str(PATCHED_CLI), role, "--work", str(work)]
            self.members.append(Member(role, command, environment, self.folder / f"{role}{i}.log"))
        for member in self.members:
            member.start()

    def stop(self) -> None:
        for member in self.members:
            member.kill()

    def post(self, map_id: str, seed: int, **told: Any) -> str | None:
        """The id of a build that the service took; None when it was not there to take it.

        Args:
            told: what the build does, as ``config_telling`` says.
        """
        try:
            response = httpx.post(
                f"http://127.0.0.1:{self.port}/maps",
                data={
                    "map_id": map_id,
                    "config": json.dumps(config_telling(**{"seed": seed, "stage_s": STAGE_S, **told})),
                },
                files={"source": ("a.xyz", b"0 0 0\n" * 1000 + str(seed).encode())},
                timeout=30,
            )
        except httpx.HTTPError:
            return None
        return str(response.json()["build_id"]) if response.status_code == 202 else None

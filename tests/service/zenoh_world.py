"""The example files of deploy/zenoh in use: a router, replicas and clients on loopback, over TLS."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

import zenoh

from tests.certificates import certificates
from tests.servers import free_port, running
from tests.service.service_world import environment_of
from tests.waiting import wait_until

EXAMPLES = Path(__file__).resolve().parents[2] / "deploy" / "zenoh"
_INSTALLED = "/etc/firstfix/zenoh"
_ROUTER = "import sys, time, zenoh; s = zenoh.open(zenoh.Config.from_file(sys.argv[1])); time.sleep(3600)"


def running_router(config: Path, port: int) -> AbstractContextManager[subprocess.Popen[bytes]]:
    return running([sys.executable, "-c", _ROUTER, str(config)], port, config.with_name("router.log"))


class ZenohWorld:
    """A zenoh router with TLS.

    Attributes:
        folder: the example files, with other paths and addresses, and certificates.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.port = free_port()
        folder.mkdir()
        for example in EXAMPLES.iterdir():
            text = example.read_text().replace(_INSTALLED, str(folder))
            text = text.replace("router.example:7447", f"127.0.0.1:{self.port}")
            text = text.replace("[::]:7447", f"127.0.0.1:{self.port}")
            (folder / example.name).write_text(text)
        make_certificates(folder)

    def router(self) -> AbstractContextManager[subprocess.Popen[bytes]]:
        return running_router(self.folder / "router.json5", self.port)

    def config_of(self, user: str, password: str | None = None) -> Path:
        """Configuration file of the robots, for another user."""
        text = (self.folder / "robot.json5").read_text()
        secret = password or f"change-me-{user}"
        text = text.replace('"robot"', f'"{user}"').replace("change-me-robot", secret)
        path = self.folder / f"{user}-{password}.json5"
        path.write_text(text)
        return path

    @contextmanager
    def session(self, user: str) -> Iterator[zenoh.Session]:
        session = zenoh.open(zenoh.Config.from_file(str(self.config_of(user))))
        try:
            yield session
        finally:
            session.close()

    @contextmanager
    def replica(
        self, name: str, store: str, *, has_router: bool = True, fake_seconds: float = 0.0, **settings: object
    ) -> Iterator[subprocess.Popen[bytes]]:
        """Runs a service process behind the router; yields when its token is there."""
        config = self.folder / "replica.json5"
        given = {"store": store, "port": 0, "workers": 2, "zenoh_config": config, "replica": name}
        environment = environment_of(self.folder / name, **{"poll_interval_s": 0.2, **given, **settings})
        with (self.folder / f"{name}.log").open("ab") as log:
            process = subprocess.Popen(
                [sys.executable, str(Path(__file__).with_name("replica_process.py"))],
                env={**environment, "FAKE_SECONDS": str(fake_seconds)},
                stdout=log,
                stderr=log,
            )
        try:
            if has_router:
                with self.session("robot") as session:
                    wait_until(lambda: name in self.replicas(session) or process.poll() is not None)
            assert process.poll() is None, (self.folder / f"{name}.log").read_text()[-2000:]
            yield process
        finally:
            process.send_signal(signal.SIGCONT)
            process.kill()
            process.wait()

    def replicas(self, session: zenoh.Session, map_id: str = "@any") -> set[str]:
        """Returns the names of the replicas with a token for a map."""
        replies = session.liveliness().get(f"firstfix/{map_id}/localize/*", timeout=5)
        return {str(reply.ok.key_expr).rsplit("/", 1)[1] for reply in replies if reply.ok is not None}


def make_certificates(folder: Path) -> None:
    """Makes an authority (ca.pem) and, signed by it, a certificate and key for the router on 127.0.0.1."""
    _, server, _ = certificates(folder)
    for name in ("router.pem", "router.key"):
        shutil.copy(server, folder / name)

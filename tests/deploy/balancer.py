"""The proxy that compose ships, in front of replicas on this machine."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import httpx

from tests.servers import free_port, running
from tests.waiting import wait_until

SHIPPED = Path(__file__).parents[2] / "deploy" / "compose" / "haproxy.cfg"
BACKENDS = ("queries", "rest")


class Balancer:
    """HAProxy before replicas, with the options of the shipped file."""

    def __init__(self, port: int, metrics_port: int, replicas: int) -> None:
        self.url = f"http://127.0.0.1:{port}"
        self._metrics = f"http://127.0.0.1:{metrics_port}/metrics"
        self._replicas = replicas

    def wait_until_all_up(self) -> None:
        """Waits until the balancer knows that all replicas are ready."""
        wait_until(lambda: all(self.number_up(backend) == self._replicas for backend in BACKENDS))

    def number_up(self, backend: str = "queries") -> int:
        """Returns the number of replicas that get queries now."""
        said = httpx.get(self._metrics, timeout=10.0).raise_for_status().text
        name = f'haproxy_backend_agg_server_status{{proxy="{backend}",state="UP"}}'
        return next(int(line.split()[-1]) for line in said.splitlines() if line.startswith(name))


def shipped_config(port: int, metrics_port: int, replica_ports: Sequence[int]) -> str:
    """Returns the shipped file with the ports of this machine in place of compose's names.

    Raises:
        ValueError: the shipped file does not have a line that must be replaced.
    """
    servers = "\n".join(f"  server r{i} 127.0.0.1:{its}" for i, its in enumerate(replica_ports))
    config = SHIPPED.read_text()
    for pattern, here, times in (
        (r"(?m)^  bind :8080$", f"  bind 127.0.0.1:{port}", 1),
        (r"(?m)^  bind :8404$", f"  bind 127.0.0.1:{metrics_port}", 1),
        (r"(?m)^  server-template .*$", servers, len(BACKENDS)),
        (r" resolvers docker init-addr none\b", "", len(BACKENDS)),
    ):
        config, replaced = re.subn(pattern, here, config)
        if replaced != times:
            raise ValueError(f"{SHIPPED.name} has {pattern!r} {replaced} times, expected {times}")
    return config


@contextmanager
def balancer(replica_ports: Sequence[int], directory: Path) -> Iterator[Balancer]:
    """Runs the shipped proxy before replicas on the given ports."""
    port, metrics_port = free_port(), free_port()
    config, log = directory / "haproxy.cfg", directory / "haproxy.log"
    config.write_text(shipped_config(port, metrics_port, replica_ports))
    with running(["haproxy", "-db", "-f", str(config)], port, log):
        yield Balancer(port, metrics_port, len(replica_ports))

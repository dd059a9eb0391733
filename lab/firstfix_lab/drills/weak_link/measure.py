"""A service at one end of a weak link, robots at the other, one after another."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from firstfix_cli.free_port import free_port
from firstfix_client import Client

from ...common.programs import replica
from .link import Conditions, Link, weak_link
from .robot import CLIENTS, Row

SLOW_S = 60.0  # the deadline of what is too large for the link
# Two zenoh sessions on one machine find each other there and leave the link alone.
NO_SHARED_MEMORY = 'mount -t tmpfs robot /dev/shm && exec "$@"'


def measure(
    conditions: Conditions, folder: Path, store: Path, map_id: str, scans: tuple[str, ...], queries: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Rows by name: compact queries from this end, then by every client, then larger ones by ``Client``.

    Args:
        folder: for the service's log and caches.
        queries: of every client.
    """
    with weak_link(conditions) as link:
        zenoh = f"tcp/{link.address}:{free_port()}"
        settings = {"store": store, "host": link.address, "auth": "off", "run_builds": False}
        with replica(folder, **settings, zenoh=True, zenoh_listen=[zenoh]) as service:
            with Client(service.url) as client:
                client.localize(scans[0], map_id=map_id)  # from this end: the first loads the version
            row = Row("Client", "compact", queries, service.url, zenoh, map_id, scans)
            yield "Client, compact, without the link", asked(row)
            larger = (("scan", max(1, queries // 10)), ("raw", max(1, queries // 33)))
            for name in CLIENTS:
                row = Row(name, "compact", queries, service.url, zenoh, map_id, scans)
                yield f"{name}, compact", asked_over(link, row)
            for encoding, count in larger:
                row = Row("Client", encoding, count, service.url, zenoh, map_id, scans, SLOW_S)
                yield f"Client, {encoding}", asked_over(link, row)


def asked(row: Row, around: Sequence[str] = ()) -> dict[str, Any]:
    """One robot's figures, asked from where the command ``around`` puts it; here without one."""
    program = [sys.executable, "-m", "firstfix_lab.drills.weak_link.robot", json.dumps(asdict(row))]
    done = subprocess.run([*around, *program], stdout=subprocess.PIPE, text=True, check=True)
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def asked_over(link: Link, row: Row) -> dict[str, Any]:
    """One robot's figures, with the bytes of a query on the link and the share of lost packets.

    The bytes are those of whole packets, headers included.

    Raises:
        subprocess.CalledProcessError: the robot's program failed.
    """
    ways = (link.up, link.down)
    before = [(way.packets, way.lost, way.bytes) for way in ways]
    figures = asked(row, ["ip", "netns", "exec", link.namespace, "sh", "-c", NO_SHARED_MEMORY, "sh"])
    now = [(way.packets, way.lost, way.bytes) for way in ways]
    packets, lost, up, down = (
        now[0][0] + now[1][0] - before[0][0] - before[1][0],
        now[0][1] + now[1][1] - before[0][1] - before[1][1],
        now[0][2] - before[0][2],
        now[1][2] - before[1][2],
    )
    return figures | {
        "bytes_up": round(up / row.queries),
        "bytes_down": round(down / row.queries),
        "packets_lost": round(lost / packets, 4),
    }

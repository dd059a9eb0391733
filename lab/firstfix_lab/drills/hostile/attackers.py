"""The process of the attackers, apart from the clients that are measured.

    python -m firstfix_lab.drills.hostile.attackers 'slow heads' --port 8080 --map hall --version V --key K

It attacks this machine alone, from loopback addresses of its own, and prints the counts of its connections
as JSON.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import signal
import socket
import sys
from collections import Counter
from contextlib import suppress

from .attacks import ATTACKS, Attack, Target

TARGET_ADDRESS = "127.0.0.1"
FIRST_ADDRESS = 66  # the last byte of the attackers' first address
AGAIN_S = 0.5  # until an attacker that was thrown out comes again


async def attack(attack: Attack, target: Target, port: int, share: float, seconds: float) -> Counter[str]:
    """Counts of connections that were opened, ended by the service and refused, until SIGTERM.

    Args:
        share: of the attack's connections.
        seconds: at most.
    """
    seen: Counter[str] = Counter()

    async def one(number: int) -> None:
        address = f"127.0.0.{FIRST_ADDRESS + number % attack.addresses}"
        for _ in range(attack.rounds):
            try:
                reader, writer = await _connect(port, address)
            except OSError:
                seen["refused"] += 1
            else:
                seen["opened"] += 1
                try:
                    await attack.act(target, reader, writer)
                except (OSError, EOFError):
                    seen["thrown_out"] += 1
                finally:
                    writer.transport.abort()
            await asyncio.sleep(AGAIN_S)

    told_to_stop = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, told_to_stop.set)
    tasks = [asyncio.create_task(one(n)) for n in range(max(1, round(attack.connections * share)))]
    print("begun", flush=True)
    with suppress(TimeoutError):
        await asyncio.wait_for(told_to_stop.wait(), seconds)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return seen


async def _connect(port: int, address: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    """A connection that takes little in before its reader does."""
    own = socket.socket()
    own.setblocking(False)
    try:
        own.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        own.bind((address, 0))
        await asyncio.get_running_loop().sock_connect(own, (TARGET_ADDRESS, port))
        return await asyncio.open_connection(sock=own)
    except BaseException:
        own.close()
        raise


def main() -> None:
    parser = argparse.ArgumentParser(prog="firstfix-lab .hostile.attackers", description=__doc__)
    parser.add_argument("attack", choices=ATTACKS)
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--map", required=True, metavar="ID")
    parser.add_argument("--version", required=True, metavar="DIGEST")
    parser.add_argument("--key", required=True)
    parser.add_argument("--points", type=int, default=1, help="of the map's cloud")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--share", type=float, default=1.0, help="of the attack's connections")
    given = parser.parse_args()
    target = Target(given.map, given.version, given.key, given.points)
    seen = asyncio.run(attack(ATTACKS[given.attack], target, given.port, given.share, given.seconds))
    json.dump(seen, sys.stdout)


if __name__ == "__main__":
    main()

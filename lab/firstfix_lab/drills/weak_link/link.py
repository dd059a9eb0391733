"""A slow, late and lossy link to a network namespace, packet by packet.

It does what ``tc qdisc add ... netem rate delay loss`` does, also where the kernel has no sch_netem: between
two TUN devices, one here and one in a namespace of its own, this process holds every packet back or drops it.
TCP at both ends is the kernel's, with all that it does about loss.
"""

from __future__ import annotations

import fcntl
import os
import random
import secrets
import select
import shutil
import struct
import subprocess
import threading
import time
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass

_TUNSETIFF, _IFF_TUN, _IFF_NO_PI = 0x400454CA, 0x0001, 0x1000
_MAX_PACKET_BYTES = 65536
_MAX_WAITING = 1000  # packets, as netem's


def missing() -> str | None:
    """Try to make a link. Returns the reason why it cannot be made, or None."""
    if os.geteuid() != 0:
        return "needs root, for network namespaces: sudo make test"
    if shutil.which("ip") is None:
        return "needs ip: apt-get install iproute2"
    try:
        with weak_link(Conditions(1e6, 0.0, 0.0)):
            return None
    except (OSError, RuntimeError) as error:  # no TUN, or a container that may not
        return f"needs TUN devices and network namespaces, as outside of a container: {error}"


@dataclass(frozen=True)
class Conditions:
    """Bandwidth, delay and loss of the link, the same both ways.

    Attributes:
        delay_s: one way, after its last bit is sent; the round trip has it twice.
        loss: 0..1, of each packet by itself.
        congestion: what TCP at both ends does about loss, whatever this machine does elsewhere. CUBIC is what
            Linux has unless told otherwise.
    """

    rate_bit_s: float
    delay_s: float
    loss: float
    congestion: str = "cubic"


class Way:
    """One direction: packets are read at one TUN device and, later or never, written to the other."""

    def __init__(self, source: int, sink: int, conditions: Conditions, rng: random.Random) -> None:
        self.source = source
        self.packets = self.lost = self.bytes = 0
        self._sink, self._conditions, self._rng = sink, conditions, rng
        self._free_s = 0.0  # when the last packet's last bit is sent
        self._flying: deque[tuple[float, bytes]] = deque()

    def take(self) -> None:
        """Everything that waits at the source."""
        while True:
            try:
                packet = os.read(self.source, _MAX_PACKET_BYTES)
            except BlockingIOError:
                return
            if packet[0] >> 4 != 4:
                continue  # IPv6 looks for its neighbours: nobody's query
            self.packets += 1
            if self._rng.random() < self._conditions.loss or len(self._flying) >= _MAX_WAITING:
                self.lost += 1
                continue
            self.bytes += len(packet)
            self._free_s = max(time.monotonic(), self._free_s) + 8 * len(packet) / self._conditions.rate_bit_s
            self._flying.append((self._free_s + self._conditions.delay_s, packet))

    def deliver(self) -> float:
        """Delivers the packets that have arrived. Returns the seconds until the next one, at most 1."""
        while self._flying and (left_s := self._flying[0][0] - time.monotonic()) <= 0:
            os.write(self._sink, self._flying.popleft()[1])
        return min(left_s, 1.0) if self._flying else 1.0


@dataclass(frozen=True)
class Link:
    """A link that is up.

    Attributes:
        namespace: where robots are: ``ip netns exec NAMESPACE ...``.
        address: of this side, for the service to listen at.
        up, down: from the robots to the service, and back.
    """

    namespace: str
    address: str
    up: Way
    down: Way


@contextmanager
def weak_link(conditions: Conditions, seed: int = 0) -> Iterator[Link]:
    """Up for as long as the block lasts. Its addresses are of RFC 2544's block for measurements.

    Raises:
        RuntimeError: ``ip`` failed.
        OSError: no TUN device can be had.
    """
    name = f"ff{secrets.token_hex(4)}"
    here, there = f"{name}h", f"{name}r"
    block, first = secrets.randbelow(256), 4 * secrets.randbelow(64)
    address, robot = (f"198.18.{block}.{first + host}" for host in (1, 2))
    ends: list[int] = []
    try:
        _ip("netns", "add", name)
        for device in (here, there):
            ends.append(_tun(device))
        _ip("link", "set", there, "netns", name)
        for place, device, own, other in (((), here, address, robot), (("-n", name), there, robot, address)):
            _ip(*place, "address", "add", own, "peer", other, "dev", device)
            _ip(*place, "link", "set", device, "up")
            route = (other, "dev", device, "src", own, "congctl", conditions.congestion)
            _ip(*place, "route", "replace", *route)
        _ip("-n", name, "link", "set", "lo", "up")
        rng = random.Random(seed)
        up, down = (Way(source, sink, conditions, rng) for source, sink in (ends[::-1], ends))
        with _relaying(up, down):
            yield Link(name, address, up, down)
    finally:
        for end in ends:
            os.close(end)  # the device goes with it
        with suppress(RuntimeError):
            _ip("netns", "delete", name)


@contextmanager
def _relaying(*ways: Way) -> Iterator[None]:
    wake, ended = os.pipe()

    def relay() -> None:
        sources = [wake, *(way.source for way in ways)]
        readable: list[int] = []
        while wake not in readable:
            for way in ways:
                way.take()
            wait_s = min(way.deliver() for way in ways)
            readable = select.select(sources, [], [], wait_s)[0]

    thread = threading.Thread(target=relay, daemon=True)
    thread.start()
    try:
        yield
    finally:
        os.close(ended)  # which makes the other end readable
        thread.join()
        os.close(wake)


def _tun(name: str) -> int:
    """A new TUN device of that name; it lasts as long as the descriptor."""
    descriptor = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(descriptor, _TUNSETIFF, struct.pack("16sH22x", name.encode(), _IFF_TUN | _IFF_NO_PI))
    return descriptor


def _ip(*arguments: str) -> None:
    done = subprocess.run(["ip", *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(f"ip {' '.join(arguments)}: {done.stderr.strip()}")

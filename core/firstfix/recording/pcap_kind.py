"""Whose packets a capture holds, by the first of them."""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from ..errors import MalformedData, UnsupportedFormat

VELODYNE, OUSTER = "Velodyne", "Ouster"
_MAGIC = {
    b"\xd4\xc3\xb2\xa1": "<",
    b"\xa1\xb2\xc3\xd4": ">",
    b"\x4d\x3c\xb2\xa1": "<",
    b"\xa1\xb2\x3c\x4d": ">",
}
_PCAPNG = b"\x0a\x0d\x0d\x0a"
_LINK_BYTES = {1: 14, 101: 0, 113: 16, 276: 20, 228: 0}  # Ethernet, raw, Linux cooked 1 and 2, IPv4
_LOOKED_AT = 2_000  # packets: the IMU's and others come between
_MAX_RECORD_BYTES = 262_144
_OUSTER_PORTS = (7502, 7503)


def kind_of(path: Path) -> str:
    """``VELODYNE`` or ``OUSTER``: whose packets a capture holds.

    Raises:
        UnsupportedFormat: of another maker, of several Velodynes, or in another form; the error names what to
            do.
        MalformedData: no capture.
    """
    makers: Counter[str] = Counter()
    velodynes = set()
    for source, port, size, begin in _packets(path):
        if size == 1206 and begin[:2] in (b"\xff\xee", b"\xff\xdd"):
            makers[VELODYNE] += 1
            velodynes.add((source, port))
        elif begin[:2] == b"\xee\xff":
            makers["Hesai"] += 1
        elif begin[:4] in (b"\x55\xaa\x05\x0a", b"\x55\xaa\x05\x5a"):
            makers["RoboSense"] += 1
        elif 56_000 <= port <= 57_000:
            makers["Livox"] += 1
        elif port in _OUSTER_PORTS or begin[:2] == b"\x01\x00":
            makers[OUSTER] += 1
    if len(velodynes) > 1:
        source, port = sorted(velodynes)[0]
        raise UnsupportedFormat(
            f"packets of {len(velodynes)} Velodynes: take one out of it with "
            f"`tcpdump -r {path.name} -w one.pcap src host "
            f"{'.'.join(map(str, source))} and udp port {port}`"
        )
    if not makers:
        raise UnsupportedFormat("no packets of a LiDAR among the first ones")
    maker = makers.most_common(1)[0][0]
    if maker not in (VELODYNE, OUSTER):
        raise UnsupportedFormat(
            f"packets of a {maker}, of which no reader can be installed: play them through the maker's "
            "driver, and record the PointCloud2 that it sends"
        )
    return maker


def _packets(path: Path) -> Iterator[tuple[bytes, int, int, bytes]]:
    """Yield sender, port, size and the first bytes of the first UDP packets."""
    with path.open("rb") as file:
        head = file.read(24)
        if head[:4] == _PCAPNG:
            raise UnsupportedFormat(
                f"a capture in the form pcapng: `editcap -F pcap {path.name} plain.pcap` makes a plain one"
            )
        order = _MAGIC.get(head[:4])
        if order is None or len(head) < 24:
            raise MalformedData("no capture of packets (pcap)")
        link_bytes = _LINK_BYTES.get(struct.unpack(order + "I", head[20:])[0] & 0xFFFF)
        if link_bytes is None:
            raise UnsupportedFormat("a capture of another network than Ethernet")
        for _ in range(_LOOKED_AT):
            record = file.read(16)
            if len(record) < 16:
                return
            size = struct.unpack(order + "I", record[8:12])[0]
            if size > _MAX_RECORD_BYTES:
                raise MalformedData(f"a packet of {size} bytes")
            body = file.read(size)[link_bytes:]
            if (
                len(body) < 28
                or body[0] >> 4 != 4
                or body[9] != 17
                or struct.unpack(">H", body[6:8])[0] & 0x1FFF
            ):
                continue  # no IPv4, no UDP, or not the first part of a packet
            begin = (body[0] & 15) * 4
            if len(body) < begin + 8:
                continue
            port, udp_bytes = struct.unpack(">HH", body[begin + 2 : begin + 6])
            yield body[12:16], port, udp_bytes - 8, body[begin + 8 : begin + 16]

"""Captures of LiDARs' packets (.pcap), as tcpdump writes them, and a VLP-16's packets of a room."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

NS = 10**9
VELODYNE_PORT = 2368
# Of the VLP-16's manual: elevation of each laser in the order of firing, and the times of firing.
ELEVATIONS_DEG = (-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15)
FIRING_S, LASER_S, BLOCK_S = 55.296e-6, 2.304e-6, 110.592e-6
PACKET_S = 12 * BLOCK_S
BLOCK_DEG = 0.4  # 10 turns a second: 0.398 deg


def write_pcap(
    path: Path,
    packets: Iterable[tuple[int, bytes]],
    port: int = VELODYNE_PORT,
    source: tuple[int, int, int, int] = (192, 168, 1, 201),
    *,
    order: str = "<",
) -> Path:
    """Writes the payloads of UDP packets over Ethernet, with their times in ns. Returns the path."""
    parts = [struct.pack(order + "IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65_535, 1)]
    for time_ns, payload in packets:
        udp = struct.pack(">HHHH", port, port, 8 + len(payload), 0) + payload
        ip = struct.pack(
            ">BBHHHBBH4B4B", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, *source, 255, 255, 255, 255
        )
        frame = bytes(12) + b"\x08\x00" + ip + udp
        seconds, rest = divmod(time_ns, NS)
        parts.append(struct.pack(order + "IIII", seconds, rest // 1000, len(frame), len(frame)) + frame)
    path.write_bytes(b"".join(parts))
    return path


def vlp16_packets(turns: float = 1.0, start_ns: int = 1_730_000_000 * NS) -> list[tuple[int, bytes]]:
    """The packets of a VLP-16 that stands in a room, with their times in ns.

    Its distances are those of ``room``: what a decoder makes of them must lie on the walls.
    """
    packets = []
    for number in range(round(turns * 360 / BLOCK_DEG / 12)):
        body = b""
        for block in range(12):
            azimuth = (number * 12 + block) * BLOCK_DEG
            body += struct.pack("<HH", 0xEEFF, round(azimuth * 100) % 36_000)
            for firing in range(2):
                for laser, elevation_deg in enumerate(ELEVATIONS_DEG):
                    within_s = firing * FIRING_S + laser * LASER_S
                    turned_deg = azimuth + BLOCK_DEG * within_s / BLOCK_S
                    distance = room(turned_deg, elevation_deg)
                    body += struct.pack("<HB", round(distance / 0.002), 10 + laser)
        after_us = round(number * PACKET_S * 1e6)
        seconds, rest = divmod(start_ns, NS)
        since_hour_us = (seconds % 3600) * 1_000_000 + rest // 1000 + after_us
        packets.append((start_ns + after_us * 1000, body + struct.pack("<IBB", since_hour_us, 0x37, 0x22)))
    return packets


HALF_WIDTH_M, HALF_LENGTH_M = 6.0, 9.0  # of the room's walls, in x and y


def room(azimuth_deg: float, elevation_deg: float) -> float:
    """Range in metres to the walls of a room without floor or ceiling. Azimuth clockwise, as Velodyne's."""
    azimuth, elevation = np.radians(azimuth_deg), np.radians(elevation_deg)
    across, along = abs(np.sin(azimuth)), abs(np.cos(azimuth))
    return float(min(HALF_WIDTH_M / max(across, 1e-9), HALF_LENGTH_M / max(along, 1e-9)) / np.cos(elevation))


def wall_distance_m(points: NDArray[np.floating]) -> NDArray[np.float64]:
    """(n,) distances of points to the nearest wall. Velodyne's drivers turn the axes: x is its y."""
    x, y = np.abs(np.asarray(points, np.float64)[:, :2].T)
    return np.minimum(np.abs(x - HALF_LENGTH_M), np.abs(y - HALF_WIDTH_M))

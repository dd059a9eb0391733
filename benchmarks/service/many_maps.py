"""More maps than the cache holds: right answers, bounded memory."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import httpx

from ..common.load import Body
from ..common.memory import pss_of_family
from ..common.programs import replica
from .queried_version import QueriedVersion


def many_maps(
    queried: QueriedVersion,
    bodies: list[Body],
    directory: Path,
    maps: int = 10,
    held: int = 3,
    rounds: int = 3,
) -> dict[str, Any]:
    """Ten maps with files of their own, asked in turn under a limit of bytes that holds three.

    Returns:
        ``wrong``: answers that differ from what a replica without a limit says of the same scan.
    """
    store = str(directory / "store")
    names = [f"map-{i}" for i in range(maps)]
    for name in names:
        queried.publish(store, name, directory, mark=name)
    size = sum(path.stat().st_size for path in queried.version.iterdir())
    settings = {"store": store, "run_builds": False, "poll_interval_s": 5.0}
    wanted = [queried.localizer().localize(scan).T_map_sensor for scan in queried.scans[: len(bodies)]]
    wrong, seconds, peak = 0, [], 0
    with (
        replica(directory / "replica", cache_max_bytes=int((held + 0.5) * size), **settings) as one,
        httpx.Client(base_url=one.url, timeout=120) as http,
    ):
        for turn in range(rounds):
            for number, name in enumerate(names):
                which = (turn * maps + number) % len(bodies)
                begin = time.perf_counter()
                answer = http.post(
                    "/localize",
                    params={"map": name},
                    content=bodies[which].content,
                    headers={"Content-Type": bodies[which].media_type},
                )
                seconds.append(time.perf_counter() - begin)
                found = answer.raise_for_status().json()
                wrong += found["map_id"] != name or not _same(found, wanted[which])
                peak = max(peak, pss_of_family(one.pid))
    seconds.sort()
    return {
        "maps": maps,
        "held": held,
        "version_mb": round(size / 1e6),
        "queries": len(seconds),
        "wrong": wrong,
        "p50_s": round(seconds[len(seconds) // 2], 3),
        "max_s": round(seconds[-1], 3),
        "peak_pss_mb": round(peak / 1e6),
    }


def _same(found: dict[str, Any], wanted: Any) -> bool:
    """Compares poses to the centimetre, as they are sent."""
    pose = found["T_map_sensor"]
    if pose is None or wanted is None:
        return (pose is None) == (wanted is None)
    return all(abs(a - b) < 0.05 for a, b in zip(pose["position"], wanted[:3, 3], strict=True))

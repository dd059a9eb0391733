"""Cost of the number of maps for one replica: at the start, without queries, and at a query."""

from __future__ import annotations

import random
import re
import time
from pathlib import Path
from statistics import median
from typing import Any

import httpx

from firstfix_cli.free_port import free_port
from firstfix_client import ZenohClient
from firstfix_service.query_workers.query import MAX_MAPS

from ...common.load import Body
from ...common.memory import pss_of_family
from ...common.programs import replica
from .catalogs import name_of

POLL_S = 2.0
COLD, WARM = 20, 40
SETTLE_S = 5.0  # from ready, and shown, to idle
_SAMPLE = re.compile(r"^(\w+)(?:\{([^}]*)\})? (\S+)$", re.M)


def one_replica(
    store: str, maps: int, body: Body, directory: Path, idle_s: float, seed: int
) -> dict[str, Any]:
    """Figures of a replica with the settings that it comes with, one worker, and zenoh."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    settings = {
        "store": store,
        "run_builds": False,
        "workers": 1,
        "poll_interval_s": POLL_S,
        "zenoh": True,
        "zenoh_listen": [endpoint],
        "replica": "r1",
        "log_level": "warning",
    }
    begin = time.perf_counter()
    with (
        replica(directory, **settings) as one,
        httpx.Client(base_url=one.url, timeout=120.0) as http,
        ZenohClient(endpoint) as robot,
    ):
        figures: dict[str, Any] = {"maps": maps, "ready_s": round(time.perf_counter() - begin, 2)}
        figures["tokens_s"] = round(_until_shown(http, maps), 2)
        before = _Counted(http)
        figures["requests_until_ready"] = before.requests
        figures["cpu_s_until_ready"] = round(before.cpu_s, 2)
        figures["index_s"] = round(_until_indexed(http, maps), 2)
        figures["requests_until_indexed"] = _Counted(http).requests
        time.sleep(SETTLE_S)
        figures["pss_mb"] = round(pss_of_family(one.pid) / 1e6)
        before = _Counted(http)
        time.sleep(idle_s)
        after = _Counted(http)
        minutes = (after.at - before.at) / 60
        figures["requests_a_minute"] = round((after.requests - before.requests) / minutes)
        figures["cpu_s_a_minute"] = round((after.cpu_s - before.cpu_s) / minutes, 2)

        chosen = random.Random(seed).sample(range(maps), COLD)
        before = _Counted(http)
        cold = [_asked(http, name_of(number), body) for number in chosen]
        after = _Counted(http)
        loads = max(after.loads - before.loads, 1)
        figures["requests_a_cold_query"] = round((after.requests - before.requests) / loads, 1)
        figures["cold_query_ms"] = round(1e3 * median(cold), 1)
        warm = [_asked(http, name_of(chosen[-1]), body) for _ in range(WARM)]
        figures["warm_query_ms"] = round(1e3 * median(warm), 1)
        begin = time.perf_counter()
        assert len(robot.maps()) == maps
        figures["list_maps_ms"] = round(1e3 * (time.perf_counter() - begin), 1)
    return figures


def memory_of_loaded(store: str, versions: tuple[int, int], directory: Path) -> dict[str, Any]:
    """Memory of a loaded version beside its files, which are links to one version here.

    A replica that has loaded few versions is compared with one that has loaded more.
    """
    settings = {"store": store, "run_builds": False, "workers": 1, "log_level": "warning"}
    mb = []
    for count in versions:
        pinned = [name_of(k) for k in range(count)]
        with replica(directory / f"{count}", pinned_maps=pinned, **settings) as one:
            loaded = httpx.get(f"{one.url}/metrics").text
            assert f"firstfix_versions_loaded {count:.1f}" in loaded
            mb.append(pss_of_family(one.pid) / 1e6)
    each = (mb[1] - mb[0]) / (versions[1] - versions[0])
    return {"loaded": versions, "pss_mb": [round(value) for value in mb], "mb_each": round(each, 2)}


class _Counted:
    """Counters of the service."""

    def __init__(self, http: httpx.Client) -> None:
        text = http.get("/metrics").raise_for_status().text
        samples = [(name, float(value)) for name, _, value in _SAMPLE.findall(text)]
        self.at = time.perf_counter()
        self.requests = int(sum(value for name, value in samples if name == "firstfix_store_seconds_count"))
        self.loads = int(sum(value for name, value in samples if name == "firstfix_version_loads_total"))
        self.cpu_s = next(value for name, value in samples if name == "process_cpu_seconds_total")


def _until_shown(http: httpx.Client, maps: int) -> float:
    """Seconds until there is a token for each map."""
    begin = time.perf_counter()
    while f"\nfirstfix_zenoh_maps {maps:.1f}\n" not in http.get("/metrics").text:
        time.sleep(0.1)
    return time.perf_counter() - begin


def _until_indexed(http: httpx.Client, maps: int) -> float:
    """Seconds until the coarse index has all maps. Of few maps there is none."""
    begin = time.perf_counter()
    while maps > MAX_MAPS and f"\nfirstfix_coarse_maps {maps:.1f}\n" not in http.get("/metrics").text:
        time.sleep(0.1)
    return time.perf_counter() - begin


def _asked(http: httpx.Client, map_id: str, body: Body) -> float:
    begin = time.perf_counter()
    http.post(
        "/localize", params={"map": map_id}, content=body.content, headers={"Content-Type": body.media_type}
    ).raise_for_status()
    return time.perf_counter() - begin

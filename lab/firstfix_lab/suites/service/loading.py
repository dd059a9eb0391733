"""Time from the store to a version's first answer, and the cost of a change of versions."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import Any

import httpx

from ...common.load import Body, Crowd, ask_over_http
from ...common.programs import replica
from .queried_version import QueriedVersion

MAP = "bench"
POLL_S = 0.5


def cold_load(queried: QueriedVersion, body: Body, directory: Path) -> dict[str, float]:
    """Seconds of the first query for a version that the replica has never seen, and of the next one.

    The cache is empty and the poll is off, so the query itself fetches, verifies and loads the version.
    """
    store = str(directory / "store")
    with replica(directory / "replica", store=store, poll_interval_s=3600, run_builds=False) as one:
        queried.publish(store, MAP, directory)
        seconds = []
        with httpx.Client(base_url=one.url, timeout=120) as http:
            for _ in range(2):
                begin = time.perf_counter()
                http.post(
                    "/localize",
                    params={"map": MAP},
                    content=body.content,
                    headers={"Content-Type": body.media_type},
                ).raise_for_status()
                seconds.append(time.perf_counter() - begin)
    return {"first_query_s": round(seconds[0], 3), "second_query_s": round(seconds[1], 3)}


def hot_swap(
    queried: QueriedVersion,
    bodies: list[Body],
    directory: Path,
    clients: int = 2,
    swaps: int = 6,
    calm_s: float = 2.0,
    pause_s: float = 0.0,
) -> dict[str, Any]:
    """Activate two versions in turn while clients ask.

    Returns how long it took until the other version answered, and what the clients saw.
    """
    store = str(directory / "store")
    versions = [queried.publish(store, MAP, directory, mark) for mark in ("one", "two")]
    delays = []
    with (
        replica(directory / "replica", store=store, poll_interval_s=POLL_S, run_builds=False) as one,
        httpx.Client(base_url=one.url, timeout=60) as http,
        Crowd(partial(ask_over_http, one.url, MAP), bodies, clients, pause_s) as crowd,
    ):
        for turn in range(swaps):
            crowd.go_on(calm_s)
            wanted = versions[turn % 2]
            begin = time.perf_counter()
            http.post(f"/maps/{MAP}/versions/{wanted}/activate").raise_for_status()
            while _answering(http, bodies[0]) != wanted:
                time.sleep(0.02)
            delays.append(round(time.perf_counter() - begin, 3))
    return {"activation_to_answer_s": delays, **crowd.asked.figures()}


def _answering(http: httpx.Client, body: Body) -> str:
    answer = http.post(
        "/localize", params={"map": MAP}, content=body.content, headers={"Content-Type": body.media_type}
    )
    return str(answer.raise_for_status().json()["map_version"])

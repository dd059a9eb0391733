"""Queries to replicas behind the shipped proxy while a replica or the store fails.

A version is activated, a replica is killed and started again, the cable to the object store is cut, and the
replicas are restarted one after the other.
"""

from __future__ import annotations

import os
import signal
import time
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import httpx

from tests.deploy.balancer import balancer

from ...common.load import Asked, Body, Crowd, ask_over_http
from ...common.programs import BUCKET, Replica, cable_to, missing, s3_server
from .queried_version import QueriedVersion

MAP = "bench"


@dataclass(frozen=True)
class Course:
    """Number of replicas and clients, and length of each part.

    Attributes:
        calm_s: before and after each fault.
        cut_s: without the store.
        pause_s: of a client between two queries.
    """

    replicas: int = 4
    clients: int = 4
    calm_s: float = 2.0
    cut_s: float = 60.0
    pause_s: float = 0.0


def replicas_suite(
    queried: QueriedVersion, bodies: list[Body], directory: Path, course: Course
) -> dict[str, Any]:
    """Answers that the clients saw in each part. They speak plain HTTP and repeat no query."""
    reason = missing("versitygw", "toxiproxy-server", "haproxy")
    if reason is not None:
        return {"skipped": reason}
    directory.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        port, credentials = stack.enter_context(s3_server(directory))
        cable = stack.enter_context(cable_to(port, directory))
        os.environ.update(credentials)  # for this process, which publishes, and the replicas
        query = f"endpoint=http://127.0.0.1:{cable.port}&region=us-east-1&allow_http=true"
        store = f"s3://{BUCKET}?{query}"
        first, second = (queried.publish(store, MAP, directory, mark) for mark in ("one", "two"))
        replicas = [
            Replica(
                directory / f"r{i}",
                {"store": store, "poll_interval_s": 1.0, "run_builds": False, "workers": 1},
            )
            for i in range(course.replicas)
        ]
        for one in replicas:
            stack.callback(one.end)
            one.start()
        for one in replicas:
            one.wait_until_ready()
        proxy = stack.enter_context(balancer([one.port for one in replicas], directory))
        proxy.wait_until_all_up()
        connect = partial(ask_over_http, proxy.url, MAP)
        crowd_of = partial(Crowd, connect, bodies, course.clients, course.pause_s)
        figures: dict[str, Any] = {"replicas": course.replicas}
        assert _serving(replicas) == {second}

        with crowd_of() as crowd:
            begin = time.perf_counter()
            httpx.post(
                f"{replicas[0].url}/maps/{MAP}/versions/{first}/activate", timeout=60
            ).raise_for_status()
            while _serving(replicas) != {first}:
                time.sleep(0.2)
            took_s = time.perf_counter() - begin
            crowd.go_on(course.calm_s)
        figures["activation"] = {"everywhere_after_s": round(took_s, 2), **_seen(crowd.asked)}

        with crowd_of() as crowd:
            crowd.go_on(course.calm_s)
            replicas[1].end(signal.SIGKILL)
            crowd.go_on(2.5 * course.calm_s)
            replicas[1].start().wait_until_ready()
            proxy.wait_until_all_up()
            crowd.go_on(course.calm_s)
        figures["killed_and_restarted"] = _seen(crowd.asked)

        with crowd_of() as crowd:
            cable.cut()
            crowd.go_on(course.cut_s)
            cable.mend()
            crowd.go_on(1.5 * course.calm_s)
        figures["store_cut"] = {"seconds": course.cut_s, **_seen(crowd.asked)}

        begin = time.perf_counter()
        _activate(replicas[0], second)
        while _serving(replicas) != {second}:
            time.sleep(0.2)
        figures["after_the_cut"] = {"activation_everywhere_after_s": round(time.perf_counter() - begin, 2)}

        with crowd_of() as crowd:
            for one in replicas:
                one.end(signal.SIGTERM)
                one.start().wait_until_ready()
                proxy.wait_until_all_up()
            crowd.go_on(0.0)
        figures["rolling_restart"] = _seen(crowd.asked)
    return figures


def _activate(one: Replica, version: str) -> None:
    httpx.post(f"{one.url}/maps/{MAP}/versions/{version}/activate", timeout=60).raise_for_status()


def _serving(replicas: list[Replica]) -> set[str]:
    """The versions that the replicas answer from."""
    body = b"\0" * 12  # one point: too few to be anywhere, but answered by the map's version
    found = set()
    for one in replicas:
        answer = httpx.post(
            f"{one.url}/localize",
            params={"map": MAP},
            content=body,
            headers={"Content-Type": "application/vnd.firstfix.xyz"},
            timeout=60,
        )
        found.add(str(answer.raise_for_status().json()["map_version"]))
    return found


def _seen(asked: Asked) -> dict[str, Any]:
    failed = sum(count for outcome, count in asked.outcomes.items() if outcome != "ok")
    return {"failed": failed, **asked.figures()}

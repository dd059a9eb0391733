"""Cost of ten open consoles for those who ask: latency and memory with and without them, in turns.

The consoles open their map in the first part of their time. Here they share its machine, as browsers never
do. So they are also opened at another replica, which nobody asks: what latency loses then is the machine's
part, not the service's. The service's processor time is told too.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from firstfix_cli.free_port import free_port

from ...common.large_cloud import version_with_cloud
from ...common.load import Asked, Body, Crowd, ask_over_http
from ...common.memory import pss_of_family
from ...common.processor_time import cpu_s_of_family
from ...common.programs import replica
from .queried_version import QueriedVersion

MAP = "bench"
MIB = 1 << 20
LOOK_S = 0.2  # between two looks at the memory
STATES = ("without", "elsewhere", "with")  # consoles: none, at another replica, at the one that is asked


@dataclass(frozen=True)
class ConsoleCourse:
    """Course of the measurement.

    Attributes:
        points: of the map's cloud.
        templates: marks beside it.
        clients: who ask, each again ``pause_s`` after its answer.
        rounds: each asks in all ``STATES``; the next one the other way round.
    """

    points: int = 10_000_000
    templates: int = 1_000_000
    consoles: int = 10
    clients: int = 4
    pause_s: float = 0.1
    phase_s: float = 20.0
    rounds: int = 4


def consoles(
    queried: QueriedVersion, bodies: list[Body], directory: Path, course: ConsoleCourse
) -> dict[str, Any]:
    """Latencies and MiB without and with consoles, and their ratios."""
    store = str(directory / "store")
    version_with_cloud(queried.version, directory / "drawn", course.points, course.templates)
    version = replace(queried, version=directory / "drawn").publish(store, MAP, directory)
    asked = {state: Asked() for state in STATES}
    cpu_s = dict.fromkeys(STATES, 0.0)
    mib: dict[str, float] = {}
    endpoint = f"tcp/127.0.0.1:{free_port()}"  # by which consoles hear the answers of both replicas
    common = {"store": store, "run_builds": False, "zenoh": True}
    with (
        replica(directory / "replica", workers=2, zenoh_listen=[endpoint], **common) as one,
        replica(directory / "other", workers=1, zenoh_connect=[endpoint], **common) as other,
        _console_process(one.url, version, course.consoles) as order,
        _console_process(other.url, version, course.consoles) as order_elsewhere,
        Crowd(partial(ask_over_http, one.url, MAP), bodies, course.clients, course.pause_s) as crowd,
    ):
        crowd.go_on(course.phase_s / 2, queries=4 * course.clients)  # warm
        mib["before"] = pss_of_family(one.pid) / MIB
        with _peak_of(one.pid, mib):
            for turn in range(course.rounds):
                for state in STATES if turn % 2 == 0 else reversed(STATES):
                    order("on" if state == "with" else "off")
                    order_elsewhere("on" if state == "elsewhere" else "off")
                    begin_s = cpu_s_of_family(one.pid)
                    _note(crowd, asked[state], course.phase_s)
                    cpu_s[state] += cpu_s_of_family(one.pid) - begin_s
        read = order("")
        order_elsewhere("")
    figures = {
        state: {**found.figures(), "service_cpu_s_a_second": round(cpu_s[state] / found.elapsed_s, 3)}
        for state, found in asked.items()
    }
    return {
        "cloud_points": course.points,
        "consoles": course.consoles,
        "read_by_consoles": read,
        **figures,
        "ratio_to_without": {
            state: {
                name: round(figures[state][name] / figures["without"][name], 2)
                for name in ("p50_ms", "p95_ms", "p99_ms", "service_cpu_s_a_second")
            }
            for state in STATES[1:]
        },
        "mib": {name: round(size) for name, size in mib.items()},
    }


def _note(crowd: Crowd, found: Asked, seconds: float) -> None:
    """Add to ``found`` what the crowd is answered in this time."""
    before, outcomes = len(crowd.asked.seconds), crowd.asked.outcomes.copy()
    crowd.go_on(seconds)
    found.seconds += crowd.asked.seconds[before:]
    found.outcomes += crowd.asked.outcomes - outcomes
    found.elapsed_s += seconds


@contextmanager
def _console_process(url: str, version: str, count: int) -> Iterator[Any]:
    """Give a function that orders ``on`` or ``off``; an empty order ends it and return what was read."""
    command = [
        sys.executable,
        "-m",
        "firstfix_lab.suites.service.open_consoles",
        url,
        MAP,
        version,
        str(count),
    ]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None

        def order(what: str) -> Any:
            if not what:
                process.stdin.close()
                return json.loads(process.stdout.readline())
            process.stdin.write(f"{what}\n")
            process.stdin.flush()
            assert process.stdout.readline() == "done\n", "a console was refused"
            return None

        try:
            yield order
        finally:
            process.kill()


@contextmanager
def _peak_of(pid: int, mib: dict[str, float]) -> Iterator[None]:
    """Note the most memory that a process and its children take, in MiB."""
    ended = threading.Event()

    def look() -> None:
        while not ended.wait(LOOK_S):
            mib["peak"] = max(mib.get("peak", 0.0), pss_of_family(pid) / MIB)

    thread = threading.Thread(target=look, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()

"""Robots of the smoke test: they localize the scans of a world over HTTP and zenoh, and report.

    robots.py WORLD MAP --url http://proxy:8080 [--zenoh robot.json5] --json FILE [--rounds N] [--least SHARE]

Without ``--rounds`` they run until SIGTERM. The exit code is 1 if a query failed, an answer was wrong, or
too few scans were localized. A query fails after the retries of the client; ``--no-retry`` turns them off
for the HTTP robots.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import sys
import threading
import time
from collections import Counter
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.errors import FirstfixError
from firstfix.scan_file import read_scan_file
from firstfix.transform import pose_error
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_client import Client, RetryPolicy, ZenohClient

WRONG_M = 0.5
TIMEOUT_S = 20.0


class Log:
    """Results of all robots of one transport. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.seconds: list[float] = []
        self.verdicts: Counter[str] = Counter()
        self.versions: Counter[str] = Counter()
        self.failures: list[str] = []
        self.wrong: list[str] = []
        self.in_map = 0

    def answered(self, name: str, answer: Any, truth: Any, seconds: float) -> None:
        with self._lock:
            self.seconds.append(seconds)
            self.verdicts[answer.verdict.value] += 1
            self.versions[answer.map_version[:12]] += 1
            self.in_map += truth is not None
            if answer.T_map_sensor is None:
                return
            error_m = np.inf if truth is None else pose_error(answer.T_map_sensor, truth)[0]
            if error_m > WRONG_M:
                self.wrong.append(f"{name}: off by {error_m:.2f} m")

    def failed(self, name: str, error: Exception) -> None:
        with self._lock:
            code = error.code if isinstance(error, FirstfixError) else type(error).__name__
            self.failures.append(f"{time.strftime('%H:%M:%S')} {name}: {code}: {str(error)[:150]}")

    def report(self) -> dict[str, Any]:
        taken = np.array(self.seconds or [np.nan]) * 1e3
        return {
            "queries": len(self.seconds) + len(self.failures),
            "failed": len(self.failures),
            "failures": self.failures[:10],
            "wrong": self.wrong[:10],
            "localized_share": self.verdicts["localized"] / max(1, self.in_map),
            "verdicts": dict(self.verdicts),
            "versions": dict(self.versions),
            "ms": {
                "median": round(float(np.median(taken)), 1),
                "p99": round(float(np.quantile(taken, 0.99)), 1),
                "max": round(float(taken.max()), 1),
            },
        }


def drive(
    client: Client | ZenohClient, scans: list[Any], given: argparse.Namespace, log: Log, stop: threading.Event
) -> None:
    """Runs one robot: localizes one scan after the other."""
    rounds = given.rounds
    asked = 0
    while not stop.is_set() and (rounds is None or asked < rounds * len(scans)):
        name, scan, truth = scans[asked % len(scans)]
        asked += 1
        begin = time.perf_counter()
        try:
            log.answered(name, client.localize(scan, map_id=given.map_id), truth, time.perf_counter() - begin)
        except Exception as error:
            log.failed(name, error)
        stop.wait(given.pause)


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("world", type=Path)
    parser.add_argument("map_id")
    parser.add_argument("--url", required=True)
    parser.add_argument("--zenoh")
    parser.add_argument("--json", type=Path, required=True)
    parser.add_argument("--rounds", type=int)
    parser.add_argument("--least", type=float, default=0.0, help="required share of localized scans")
    parser.add_argument("--pause", type=float, default=0.2, help="seconds between a robot's queries")
    parser.add_argument("--no-retry", action="store_true")
    given = parser.parse_args()

    stop = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stop.set())
    rows = read_poses_csv(given.world / "poses.csv")
    scans = [(row.path.name, read_scan_file(row.path), row.T_map_sensor) for row in rows]
    policy = RetryPolicy(attempts=1) if given.no_retry else RetryPolicy()
    logs = {"http": Log()} | ({"zenoh": Log()} if given.zenoh else {})
    with ExitStack() as stack:
        clients: list[tuple[str, Client | ZenohClient]] = [
            ("http", stack.enter_context(Client(given.url, timeout_s=TIMEOUT_S, retry=policy)))
            for _ in range(2)
        ]
        if given.zenoh:
            is_file = given.zenoh.endswith(".json5")
            way = {"config": given.zenoh} if is_file else {"endpoint": given.zenoh}
            clients.append(("zenoh", stack.enter_context(ZenohClient(**way, timeout_s=TIMEOUT_S))))
        robots = [
            # Each starts at another scan, so that their queries differ.
            threading.Thread(
                target=drive, args=(client, scans[start:] + scans[:start], given, logs[way], stop)
            )
            for start, (way, client) in enumerate(clients)
        ]
        for robot in robots:
            robot.start()
        for robot in robots:
            robot.join()

    reports = {way: log.report() for way, log in logs.items()}
    given.json.write_text(json.dumps(reports, indent=1) + "\n")
    print(json.dumps(reports), flush=True)
    return 0 if all(is_good(report, given.least) for report in reports.values()) else 1


def is_good(report: dict[str, Any], least: float) -> bool:
    """Returns True if the robots of a transport had no failure and enough fixes."""
    nothing_bad = not report["failed"] and not report["wrong"]
    return nothing_bad and report["queries"] > 0 and report["localized_share"] >= least


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    os._exit(status)  # zenoh's threads may outlive a broken session

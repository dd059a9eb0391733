"""Time from ``POST /maps`` to the first answer ``localized``, with other checkouts in turn.

    firstfix-lab first_answer MAP --scan FILE [--trajectory FILE] [--sensor NAME] [--config JSON]
        [--checkout ROOT ...] [--rounds 3] [--json FILE]

Each time a service of its own with an empty store is given the map, and asked the scan every quarter of a
second. Wall time counts where nothing else runs: beside other work, compare checkouts by the ratio, or give
the program the processors by ``chrt -f 1``. Processor time is that of all of the service's processes.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import httpx

from firstfix.scan_formats import SCAN_FORMATS
from firstfix_lab.checkout import ROOT

from ...common.processor_time import cpu_s_of_family
from ...common.programs import Replica

MAP = "first"
ASK_EVERY_S, LIMIT_S = 0.25, 1800.0
SETTLE_S = 10.0  # a service's own start is not measured, nor the process that it keeps ready


@dataclass(frozen=True)
class Submission:
    """A map, and a scan in it.

    Attributes:
        trajectory: TUM file of the mapping run's poses; None: there is none.
        config: of the build.
    """

    source: Path
    scan: Path
    trajectory: Path | None
    config: Mapping[str, Any]


@dataclass(frozen=True)
class FirstAnswer:
    """Seconds from the submission to the first scan that was localized, by the clock and of processors."""

    wall_s: float
    cpu_s: float


def first_answer(root: Path, given: Submission, folder: Path) -> FirstAnswer:
    """Start the service of a checkout in an empty folder, submit the map and ask until the scan is localized.

    Raises:
        RuntimeError: the service does not start, refuses the map, or never localizes the scan.
    """
    settings = {"store": str(folder / "store"), "build_ready": True}
    one = Replica(folder, settings, [str(root / ".venv/bin/firstfix"), "serve"]).start()
    try:
        one.wait_until_ready()
        time.sleep(SETTLE_S)
        with httpx.Client(base_url=one.url, timeout=120) as http:
            return _measured(http, one.pid, given)
    finally:
        one.end()


def _measured(http: httpx.Client, pid: int, given: Submission) -> FirstAnswer:
    begin_s, begin_cpu_s = time.monotonic(), cpu_s_of_family(pid)
    _submit(http, given)
    body, headers = given.scan.read_bytes(), {"Content-Type": _media_type(given.scan)}
    while time.monotonic() - begin_s < LIMIT_S:
        time.sleep(ASK_EVERY_S)
        answer = http.post("/localize", params={"map": MAP}, content=body, headers=headers)
        if answer.status_code == 200 and answer.json()["verdict"] == "localized":
            wall_s = time.monotonic() - begin_s
            return FirstAnswer(round(wall_s, 2), round(cpu_s_of_family(pid) - begin_cpu_s, 2))
    raise RuntimeError(f"{given.scan.name} was not localized within {LIMIT_S} s")


def _submit(http: httpx.Client, given: Submission) -> None:
    files = {"source": (given.source.name, given.source.read_bytes())}
    if given.trajectory is not None:
        files["trajectory"] = (given.trajectory.name, given.trajectory.read_bytes())
    answer = http.post("/maps", data={"map_id": MAP, "config": json.dumps(dict(given.config))}, files=files)
    if answer.status_code != 202:
        raise RuntimeError(f"the map was refused: {answer.text[:500]}")


def _media_type(scan: Path) -> str:
    return next(one.media_types[0] for one in SCAN_FORMATS if scan.suffix.lower() in one.suffixes)


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("map", type=Path)
    parser.add_argument("--scan", type=Path, required=True)
    parser.add_argument("--trajectory", type=Path)
    parser.add_argument("--sensor")
    parser.add_argument("--config", type=json.loads, default={})
    parser.add_argument("--checkout", type=Path, action="append", help="default: this one")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args(argv)
    config = {**chosen.config, **({} if chosen.sensor is None else {"sensor": chosen.sensor})}
    given = Submission(chosen.map, chosen.scan, chosen.trajectory, config)
    figures: dict[str, list[dict[str, float]]] = {}
    for _ in range(chosen.rounds):
        for root in chosen.checkout or [ROOT]:
            with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
                found = asdict(first_answer(root.resolve(), given, Path(folder)))
            figures.setdefault(str(root), []).append(found)
            print(root, json.dumps(found), file=sys.stderr, flush=True)
    if chosen.json is not None:
        chosen.json.write_text(json.dumps(figures, indent=1) + "\n")

"""Real maps and held-out scans, through a running service: success, error, milliseconds, build cost."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from firstfix_cli.local_service import local_service

from .datasets import HALL, STREET, Dataset
from .memory import PeakMemory

SEED = 1  # of the yaw that each scan is turned by
QUICK = (HALL,)


def run(quick: bool) -> dict[str, Any]:
    """The figures of every data set that is there; the quick suite has the hall alone."""
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": SEED}
    for dataset in QUICK if quick else (STREET, HALL):
        figures[dataset.name] = (
            measure(dataset) if dataset.available else f"skipped: {dataset.folder} is not beside the checkout"
        )
    return figures


def measure(dataset: Dataset) -> dict[str, Any]:
    """Builds the map from nothing with ``firstfix build``, then asks with ``firstfix evaluate --url``."""
    with tempfile.TemporaryDirectory(prefix="firstfix-bench-") as folder:
        scratch, store = Path(folder), Path(folder) / "store"
        config = scratch / "config.json"
        config.write_text(json.dumps(dataset.config))
        trajectory = dataset.write_trajectory(scratch / "trajectory.csv")
        queries = dataset.write_queries(scratch / "poses.csv")
        build = ["build", str(dataset.map_path), "--map-id", dataset.name, "--store", str(store)]
        build += [
            "--trajectory",
            str(trajectory),
            "--config",
            str(config),
            "--work",
            str(scratch / "work"),
            "--json",
        ]
        begin = time.monotonic()
        with PeakMemory() as memory:
            built = json.loads(_firstfix(*build))
        built |= {
            "build_s": round(time.monotonic() - begin, 1),
            "build_peak_gb": round(memory.peak_bytes / 1e9, 2),
        }
        answers = scratch / "answers.json"
        with local_service(scratch / "service", store) as service:
            evaluate = ["evaluate", str(queries), "--map", dataset.name, "--url", service.url]
            evaluate += ["--random-yaw", str(SEED), "--json", str(answers)]
            _firstfix(*evaluate)  # the first loads the version
            print(_firstfix(*evaluate), file=sys.stderr)
        return {"build": built, "queries": json.loads(answers.read_text())}


def _firstfix(*arguments: str) -> str:
    command = [sys.executable, "-m", "firstfix_cli.main", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout

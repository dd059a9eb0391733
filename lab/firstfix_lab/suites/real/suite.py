"""Real maps and held-out scans: through a running service as they are, and in this process made worse.

    firstfix-lab real [--quick] [--sets street,yard] [--json FILE]

Leaves ``report.md`` and ``answers.csv`` (one row a query) in ``build/bench/real``.
"""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from firstfix.catalog.catalog import Catalog
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.store.store import Store
from firstfix_cli.local_service import local_service
from firstfix_lab.checkout import BENCH
from tests.recorded_data import DATASETS, HALL, Dataset

from ...common.asked import Asked, figures_of
from ...common.by_dataset import Figures, measure_each
from ...common.memory import PeakMemory
from ...common.nees import nees_by_class
from .ask import GRAVITY, ask
from .report import report
from .strangers import ask_strangers
from .variants import SEED

WORK = BENCH / "real"
QUICK = (HALL,)
STORE = "store"  # in the scratch folder of a data set


def run(quick: bool, sets: Sequence[str] = ()) -> dict[str, Any]:
    """The figures of every data set that is there; the quick suite has the hall alone.

    Args:
        sets: names of the data sets; empty: all.
    """
    answers: dict[str, list[Asked]] = {}

    def measure_one(dataset: Dataset, folder: Path) -> Figures:
        figures, found = measure(dataset.converted(folder), folder)
        answers[dataset.name] = found
        return figures

    by_dataset = measure_each(QUICK if quick else DATASETS, sets, measure_one)
    WORK.mkdir(parents=True, exist_ok=True)
    _write_answers(WORK / "answers.csv", answers)
    (WORK / "report.md").write_text(report(by_dataset))
    return {"machine": {"cpus": os.cpu_count()}, "seed": SEED, "gravity": dict(GRAVITY), **by_dataset}


def measure(dataset: Dataset, scratch: Path) -> tuple[dict[str, Any], list[Asked]]:
    """Build the map from nothing with ``firstfix build``, asks over HTTP, then in this process."""
    built, version = build(dataset, scratch)
    over_http = _over_http(dataset, scratch)
    localizer = Localizer(MapIndex.load(version))
    variants, answers = in_process(dataset, localizer, scratch)
    strangers = ask_strangers(localizer)
    print(dataset.name, "strangers", strangers, file=sys.stderr, flush=True)
    nees = nees_by_class(
        [(a.T_judged, a.answer) for a in answers if a.answer.T_map_sensor is not None and not a.is_wrong]
    )
    figures = {"build": built, "over_http": over_http, "variants": variants, "nees": nees}
    return {**figures, "strangers": strangers}, answers


def in_process(
    dataset: Dataset, localizer: Localizer, work: Path
) -> tuple[dict[str, dict[str, Any]], list[Asked]]:
    """The figures of each variant, by the source of gravity, and all answers."""
    next(ask(dataset, localizer, work))  # the first query pays for what is loaded late
    answers = list(ask(dataset, localizer, work))
    groups: dict[tuple[str, str], list[Asked]] = {}
    for answer in answers:
        groups.setdefault((answer.variant, answer.gravity), []).append(answer)
    figures: dict[str, dict[str, Any]] = {}
    for (variant, gravity), group in groups.items():
        figures.setdefault(variant, {})[gravity] = figures_of(group)
        print(dataset.name, variant, gravity, figures[variant][gravity], file=sys.stderr, flush=True)
    return figures, answers


def build(dataset: Dataset, scratch: Path) -> tuple[dict[str, Any], Path]:
    """Build a data set's map from nothing with ``firstfix build``, into the scratch folder's store.

    Returns:
        What the command says, with the time and the memory that it took; and the version's directory.
    """
    store, config = scratch / STORE, scratch / "config.json"
    config.write_text(json.dumps(dataset.config))
    trajectory = dataset.write_trajectory(scratch / "trajectory.csv")
    poses = [] if trajectory is None else ["--trajectory", str(trajectory)]
    command = ["build", str(dataset.map_path), "--map-id", dataset.name, "--store", str(store), "--json"]
    command += [*poses, "--config", str(config), "--work", str(scratch / "work")]
    begin = time.monotonic()
    with PeakMemory() as memory:
        built = json.loads(_firstfix(*command))
    took = {
        "build_s": round(time.monotonic() - begin, 1),
        "build_peak_gb": round(memory.peak_bytes / 1e9, 2),
    }
    catalog = Catalog(Store.open(str(store)))
    return built | took, catalog.fetch_version(dataset.name, built["version"], scratch / "versions")


def _over_http(dataset: Dataset, scratch: Path) -> dict[str, Any]:
    """The figures of ``firstfix evaluate --url --random-yaw``, by the source of gravity."""
    queries = dataset.write_queries(scratch / "poses.csv")
    figures = {}
    with local_service(scratch / "service", scratch / STORE) as service:
        evaluate = ["evaluate", str(queries), "--map", dataset.name, "--url", service.url]
        evaluate += ["--random-yaw", str(SEED), "--json", "-"]
        _firstfix(*evaluate)  # loads the version
        for gravity, noise_deg in GRAVITY.items():
            given = [] if noise_deg is None else ["--gravity-from-poses", str(noise_deg)]
            figures[gravity] = json.loads(_firstfix(*evaluate, *given))
    return figures


def _firstfix(*arguments: str) -> str:
    command = [sys.executable, "-m", "firstfix_cli.main", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def _write_answers(path: Path, answers: Mapping[str, Sequence[Asked]]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        names = "set,scan,variant,gravity,verdict,reasons,probability,reference"
        writer.writerow([*names.split(","), "first_error_m", "first_error_deg", "ms"])
        for name, a in ((name, a) for name, of_set in answers.items() for a in of_set):
            answer = a.answer
            said = (answer.verdict.value, " ".join(answer.reasons), f"{answer.probability:.4f}")
            for reference in a.T_map_sensor:
                errors = (f"{value:.4f}" for value in a.first_error(reference))
                writer.writerow(
                    [name, a.scan, a.variant, a.gravity, *said, reference, *errors, f"{a.ms:.1f}"]
                )

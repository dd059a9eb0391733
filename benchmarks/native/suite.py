"""This checkout, and another one beside it: what a query and a build cost, and whether the answers agree.

    python -m benchmarks.run native --beside ../old --parts street,factory

Each checkout builds its own version with its own code. One process of each answers the same queries on one
thread, in turns, scan by scan: each in its own version, then both in the other checkout's version.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.scan.scan import Scan

from ..common.load import Body
from .agreement import Answer, agreement
from .build import Built, built
from .layouts import in_this_layout
from .places import FORMS, SEED, bodies_of, missing, place
from .tree import ROOT, Tree
from .worker import CannotLoad, Worker

WORK = ROOT / "build" / "bench" / "native"
PARTS = ("street", "factory", "campus")  # the campus has 108,464 templates and takes long to build
DEFAULT_PARTS = ("street", "factory")
SCANS, ROUNDS = 40, 3
THREADS, SWITCH_SCANS = 2, 10
THROUGHPUT_S = 10.0
STAGES = {
    "templates": ("make_templates",),
    "keys": ("learn_keys",),
    "index": ("build_index",),
    "self_test": ("self_test",),
    "all_others": ("read_map", "reconstruct_mesh", "sample_viewpoints", "fit_engine", "cluster"),
}


def run(quick: bool, beside: Path | None = None, parts: Sequence[str] = ()) -> dict[str, Any]:
    """The figures of each place. The quick suite asks less, and in the factory alone."""
    trees = [Tree("this", ROOT)]
    if beside is not None:
        trees.append(Tree("beside", beside.resolve()))
    figures: dict[str, Any] = {
        "machine": {"cpus": os.cpu_count()},
        "seed": SEED,
        "code": {tree.name: tree.code_digest()[:16] for tree in trees},
    }
    for name in parts or (("factory",) if quick else DEFAULT_PARTS):
        reason = missing(name)
        figures[name] = reason or _in_place(name, trees, quick)
    return figures


def _in_place(name: str, trees: list[Tree], quick: bool) -> dict[str, Any]:
    where = place(name, WORK / name)
    versions = [built(tree, where.source, WORK / name / "versions") for tree in trees]
    scans = where.scans_in(versions[0].version, 8 if quick else SCANS)
    rounds, seconds = (1, 2.0) if quick else (ROUNDS, THROUGHPUT_S)
    sides = [(tree, version.version) for tree, version in zip(trees, versions, strict=True)]
    bodies = bodies_of(scans, sides[0][1])
    figures: dict[str, Any] = {"scans": len(scans), "build_cpu_s": build_costs(trees, versions)}
    figures["own_versions"] = asked(sides, bodies, rounds)
    if len(sides) == 2:
        figures["one_version"] = asked_of_one_version(trees, sides[1][1], scans, rounds)
    for tree, version in sides:
        figures.setdefault("switches_a_fix", {})[tree.name] = {
            form: switches(tree, version, bodies[form][:SWITCH_SCANS]) for form in FORMS
        }
        figures.setdefault("fixes_a_second", {})[tree.name] = {
            form: processes(tree, version, bodies[form], seconds) for form in FORMS
        }
    return figures


def asked_of_one_version(
    trees: list[Tree], version: Path, scans: list[Scan], rounds: int
) -> dict[str, Any] | str:
    """Asks both checkouts in the version that the second built: only the code that answers differs."""
    with tempfile.TemporaryDirectory(dir=version.parent) as folder:
        here = in_this_layout(version, Path(folder) / "version")
        try:
            return asked([(trees[0], here), (trees[1], version)], bodies_of(scans, here), rounds)
        except CannotLoad as error:
            return f"skipped: {error}"


def build_costs(trees: list[Tree], versions: list[Built]) -> dict[str, Any]:
    """Returns processor seconds by group of stages, and how many times as much the other checkout takes."""
    return {
        group: _compared(
            [tree.name for tree in trees],
            [sum(version.cpu_s.get(stage, 0.0) for stage in stages) for version in versions],
        )
        for group, stages in STAGES.items()
    }


def asked(sides: list[tuple[Tree, Path]], bodies: dict[str, list[Body]], rounds: int) -> dict[str, Any]:
    """Asks every side every query, in turns, and returns costs and agreement by form.

    Raises:
        CannotLoad: the code of a side cannot read its version.
    """
    figures: dict[str, Any] = {}
    with ExitStack() as stack:
        workers = [stack.enter_context(Worker(tree, version)) for tree, version in sides]
        names = [tree.name for tree, _ in sides]
        figures["templates"] = {name: worker.templates for name, worker in zip(names, workers, strict=True)}
        for form in FORMS:
            answers, cpu_ms = in_turns(workers, bodies[form], rounds)
            figures[form] = {
                f"cpu_ms_{what}": _compared(names, [float(np.percentile(side, share)) for side in cpu_ms])
                for what, share in (("median", 50), ("p95", 95))
            }
            if len(sides) == 2:
                figures[form]["agreement"] = agreement(*answers)
    return figures


def in_turns(
    workers: Sequence[Worker], bodies: Iterable[Body], rounds: int
) -> tuple[list[list[Answer]], list[list[float]]]:
    """Asks all workers query by query; who is first changes from query to query.

    Returns:
        for each worker its answers, and for each query the least processor time of all rounds. The first
        answer of a worker is not counted: it pays for what is loaded late.
    """
    bodies = list(bodies)
    for worker in workers:
        worker.ask(bodies[0])
    answers: list[list[Answer]] = [[] for _ in workers]
    cpu_ms = np.full((len(workers), len(bodies), rounds), np.nan)
    for turn in range(rounds):
        for number, body in enumerate(bodies):
            order = range(len(workers)) if (turn + number) % 2 == 0 else reversed(range(len(workers)))
            for which in order:
                answer = workers[which].ask(body)
                cpu_ms[which, number, turn] = answer["cpu_ms"]
                if turn == 0:
                    answers[which].append(answer)
    return answers, cpu_ms.min(axis=2).tolist()


def switches(tree: Tree, version: Path, bodies: list[Body]) -> float:
    """Returns voluntary context switches a fix, of two threads that answer at the same time."""
    with Worker(tree, version) as worker:
        worker.keep(bodies)
        found = worker.call("switches", threads=THREADS)
    return round(found["voluntary"] / found["fixes"], 1)


def processes(tree: Tree, version: Path, bodies: list[Body], seconds: float) -> dict[str, float]:
    """Returns the fixes a second of one process and of two, and how many times as many two give.

    On a machine that does other work, too, the processor time of a fix says more: it grows where two
    processes are in each other's way.
    """
    with Worker(tree, version) as first, Worker(tree, version) as second:
        for worker in (first, second):
            worker.keep(bodies)
            worker.ask(bodies[0])
        one = first.call("repeat", seconds=seconds)
        for worker in (first, second):
            worker.send("repeat", seconds=seconds)
        two = [worker.reply() for worker in (first, second)]
    rate = sum(each["fixes_a_second"] for each in two)
    return {
        "one": round(one["fixes_a_second"], 1),
        "two": round(rate, 1),
        "ratio": round(rate / one["fixes_a_second"], 2),
        "cpu_ms_one": round(one["cpu_ms"], 2),
        "cpu_ms_two": round(float(np.mean([each["cpu_ms"] for each in two])), 2),
    }


def _compared(names: list[str], costs: list[float]) -> dict[str, float]:
    """Costs by name, and of two how many times as much the second is."""
    figures = {name: round(cost, 2) for name, cost in zip(names, costs, strict=True)}
    if len(costs) == 2 and costs[0]:
        figures["ratio"] = round(costs[1] / costs[0], 2)
    return figures

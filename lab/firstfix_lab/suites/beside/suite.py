"""This checkout, and another one beside it: what a query and a build cost, and whether the answers agree.

    firstfix-lab beside --beside ../old --parts street,factory

Each checkout builds its own version with its own code. One process of each answers the same queries on one
thread, in turns, scan by scan: each in its own version, then both in the other checkout's version.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from ...checkout import ROOT
from ...common.load import Body
from .agreement import Answer, agreement
from .build import Built, built
from .places import DEMO, FORMS, RECORDED, SEED, bodies_of, missing, place
from .tree import Tree
from .worker import CannotLoad, Worker

WORK = ROOT / "build" / "bench" / "beside"
# The campus has 108,464 templates and takes long to build.
PARTS = (DEMO, *RECORDED, "factory", "campus")
DEFAULT_PARTS = ("street", "factory")
SCANS, ROUNDS = 40, 3
COSTS: dict[str, Callable[[list[float]], Any]] = {
    "median": np.median,
    "p95": lambda costs: np.percentile(costs, 95),
    "mean": np.mean,
}
STAGES = {  # of a build that have a figure of their own
    "templates": "make_templates",
    "keys": "learn_keys",
    "free_space": "carve_free_space",
    "index": "build_index",
    "self_test": "self_test",
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
    rounds = 1 if quick else ROUNDS
    sides = [(tree, version.version) for tree, version in zip(trees, versions, strict=True)]
    figures: dict[str, Any] = {"scans": len(scans), "build_cpu_s": build_costs(trees, versions)}
    figures["own_versions"] = asked(sides, bodies_of(scans, sides[0][1]), rounds)
    if len(sides) == 2:  # only the code that answers differs
        other = sides[1][1]
        try:
            figures["one_version"] = asked([(tree, other) for tree in trees], bodies_of(scans, other), rounds)
        except CannotLoad as error:
            figures["one_version"] = f"skipped: {error}"
    return figures


def build_costs(trees: list[Tree], versions: list[Built]) -> dict[str, Any]:
    """Processor seconds by stage, and how many times as much the other checkout takes.

    ``all_others`` are the stages without a figure of their own, ``all`` is the whole build.
    """
    costs = {name: [version.cpu_s.get(stage, 0.0) for version in versions] for name, stage in STAGES.items()}
    costs["all_others"] = [
        sum(cost for stage, cost in version.cpu_s.items() if stage not in STAGES.values())
        for version in versions
    ]
    costs["all"] = [sum(version.cpu_s.values()) for version in versions]
    names = [tree.name for tree in trees]
    return {name: _compared(names, of_each) for name, of_each in costs.items()}


def asked(sides: list[tuple[Tree, Path]], bodies: dict[str, list[Body]], rounds: int) -> dict[str, Any]:
    """Ask every side every query, in turns, and returns costs and agreement by form.

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
                f"cpu_ms_{what}": _compared(names, [float(of_all(side)) for side in cpu_ms])
                for what, of_all in COSTS.items()
            }
            if len(sides) == 2:
                figures[form]["share_of_beside"] = shares_of(answers, cpu_ms)
                figures[form]["agreement"] = agreement(*answers)
    return figures


def shares_of(answers: list[list[Answer]], cpu_ms: list[list[float]]) -> dict[str, float | int]:
    """Processor time of this checkout's queries as a share of the other one's.

    easy_median: of the pairs of answers, where both are ``localized``. mean: of all, hard ones too, which set
    it.
    """
    here, beside = np.array(cpu_ms)
    easy = [all(side["verdict"] == "localized" for side in pair) for pair in zip(*answers, strict=True)]
    found: dict[str, float | int] = {"easy": sum(easy), "mean": round(float(here.mean() / beside.mean()), 3)}
    if any(easy):
        found["easy_median"] = round(float(np.median((here / beside)[easy])), 3)
    return found


def in_turns(
    workers: Sequence[Worker], bodies: Iterable[Body], rounds: int
) -> tuple[list[list[Answer]], list[list[float]]]:
    """Ask all workers query by query; who is first changes from query to query.

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


def _compared(names: list[str], costs: list[float]) -> dict[str, float]:
    """Costs by name, and of two how many times as much the second is."""
    figures = {name: round(cost, 2) for name, cost in zip(names, costs, strict=True)}
    if len(costs) == 2 and costs[0]:
        figures["ratio"] = round(costs[1] / costs[0], 2)
    return figures

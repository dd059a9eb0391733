"""A build in a process of its own, so that its time and memory are told apart from the suite's."""

from __future__ import annotations

import multiprocessing
import resource
import time
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from firstfix.builds.config import BuildConfig
from firstfix_builder.pipeline import build_version
from tests.recorded_data import Dataset

from ...common.memory import PeakMemory
from .trial import Preparation


@dataclass(frozen=True)
class Built:
    """A version of a map.

    Attributes:
        folder: of the version.
        preparation: what the build took.
    """

    folder: Path
    preparation: Preparation


def build(dataset: Dataset, engine: dict[str, Any], work: Path, name: str) -> Built:
    """Build a data set's map; stages that ``work`` has from an earlier build are taken from it.

    Args:
        engine: that section of the build's config; empty: the default.
        work: an existing folder.
        name: of the version's folder in ``work``, which no other build there has.

    Raises:
        RuntimeError: the build failed, see above.
    """
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    began, began_cpu_s = time.monotonic(), _cpu_s_of_ended_children()
    with PeakMemory() as memory:
        process = context.Process(target=_build, args=(theirs, dataset, engine, work, name))
        process.start()
        theirs.close()
        process.join()
    if process.exitcode:
        raise RuntimeError(f"the build of {dataset.name} ended with {process.exitcode}: see above")
    took = time.monotonic() - began, _cpu_s_of_ended_children() - began_cpu_s, memory.peak_bytes
    return Built(ours.recv(), Preparation(*took))


def _build(pipe: Connection, dataset: Dataset, engine: dict[str, Any], work: Path, name: str) -> None:
    trajectory = dataset.write_trajectory(work / "trajectory.csv")
    config = BuildConfig.parse({**dataset.config, **({"engine": engine} if engine else {})})
    built = build_version(dataset.map_path, config, work / "build", trajectory=trajectory)
    pipe.send(built.directory.rename(work / name))  # the next build puts its version in the same place


def _cpu_s_of_ended_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime

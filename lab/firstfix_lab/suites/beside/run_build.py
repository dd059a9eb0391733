"""A build with the code on the path: ``python -m firstfix_lab.suites.beside.run_build TASK.json``.

It is a process of its own, so that its processor time, and that of all it starts, belongs to this build.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

from firstfix.builds.config import BuildConfig
from firstfix_builder.pipeline import build_version

from ...common.processor_time import cpu_s_of_family


class StageCosts:
    """Processor seconds of each stage, from the progress that a build reports.

    Args:
        clock: processor seconds spent until now.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._begun: dict[str, float] = {}
        self.cpu_s: dict[str, float] = {}

    def __call__(self, stage: str, fraction: float) -> None:
        """Take a report. A stage may report several times that all is done: the last one counts."""
        now = self._clock()
        self._begun.setdefault(stage, now)
        if fraction >= 1.0:
            self.cpu_s[stage] = round(now - self._begun[stage], 2)


def main() -> None:
    """Builds, and writes ``cpu_s.json`` beside the version."""
    task = json.loads(Path(sys.argv[1]).read_text())
    work = Path(task["work"])
    costs = StageCosts(lambda: cpu_s_of_family(os.getpid()))
    build_version(
        Path(task["map"]),
        BuildConfig.parse(task["config"]),
        work,
        trajectory=Path(task["trajectory"]) if task["trajectory"] else None,
        progress=costs,
        **({"base": Path(task["base"])} if task.get("base") else {}),  # an older checkout knows none
    )
    (work / "cpu_s.json").write_text(json.dumps(costs.cpu_s))


if __name__ == "__main__":
    main()

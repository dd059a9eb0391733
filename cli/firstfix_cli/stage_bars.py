"""Progress of a build's stages: bars at a terminal, else one plain line as each stage ends."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol, TypeAlias

STAGE_CHARS = 18


class StageProgress(Protocol):
    """Display of the stages of a build."""

    def __call__(self, stage: str, fraction: float) -> None:
        """Show the share that is done, 0..1, while a stage runs. Another stage ends the one before."""

    def say(self, line: str) -> None:
        """Show a line above the stages."""


Progress: TypeAlias = Callable[[], AbstractContextManager[StageProgress]]


def stage_progress() -> AbstractContextManager[StageProgress]:
    """The display that suits standard error."""
    return stage_bars() if sys.stderr.isatty() else stage_lines()


@contextmanager
def stage_bars() -> Iterator[StageProgress]:
    """Show a progress bar for each stage, on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn(f"{{task.description:{STAGE_CHARS}}}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    tasks: dict[str, TaskID] = {}

    class Bars:
        def __call__(self, stage: str, fraction: float) -> None:
            if stage not in tasks:
                self.end()
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=fraction)

        def end(self) -> None:
            """Fill the last bar, which stops its clock."""
            for task in list(tasks.values())[-1:]:
                bars.update(task, completed=1.0)

        def say(self, line: str) -> None:
            bars.console.print(line, markup=False, highlight=False, soft_wrap=True)

    with Progress(*columns, console=Console(stderr=True)) as bars:
        shown = Bars()
        yield shown
        shown.end()  # not after an error: the last stage has not ended then


@contextmanager
def stage_lines(clock: Callable[[], float] = time.monotonic) -> Iterator[StageProgress]:
    """Write one line with the stage's time as each stage ends, on standard error."""

    class Lines:
        stage = ""
        began_s = clock()

        def __call__(self, stage: str, fraction: float) -> None:
            if stage != self.stage:
                self.end()
                self.stage, self.began_s = stage, clock()

        def end(self, how: str = "") -> None:
            if self.stage:
                self.say(f"{self.stage:{STAGE_CHARS}} {clock() - self.began_s:8.1f} s{how}")
            self.stage = ""

        def say(self, line: str) -> None:
            print(line, file=sys.stderr, flush=True)

    lines = Lines()
    try:
        yield lines
    except BaseException:
        lines.end(", not ended")
        raise
    lines.end()

"""Progress bars of a build's stages."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol, TypeAlias


class StageProgress(Protocol):
    """Display of the stages of a build."""

    def __call__(self, stage: str, fraction: float) -> None:
        """Show the share of a stage that is done, 0..1."""

    def say(self, line: str) -> None:
        """Show a line above the stages."""


Progress: TypeAlias = Callable[[], AbstractContextManager[StageProgress]]


@contextmanager
def stage_bars() -> Iterator[StageProgress]:
    """Show a progress bar for each stage, on standard error."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description:18}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f} %"),
        TimeElapsedColumn(),
    )
    tasks: dict[str, TaskID] = {}

    class Bars:
        def __call__(self, stage: str, fraction: float) -> None:
            if stage not in tasks:
                tasks[stage] = bars.add_task(stage, total=1.0)
            bars.update(tasks[stage], completed=fraction)

        def say(self, line: str) -> None:
            bars.console.print(line, markup=False, highlight=False, soft_wrap=True)

    with Progress(*columns, console=Console(stderr=True)) as bars:
        yield Bars()

"""Seconds and processor seconds of each test of a run, its processes counted.

    make test PYTEST_ARGS="-n 4 --dist loadfile --times=build/times.csv"
    python tests/harness/processor_time.py build/times.csv     # by folder and file, the dearest first

A process counts while it lives and, through the one that waited for it, when it has ended. What a service
of a file or run does in the background counts for the test that runs meanwhile. Containers are the engine's:
they do not count.
"""

from __future__ import annotations

import csv
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
_COLUMNS = ("test", "seconds", "processor_s")
_ROWS_SHOWN = 40


def processor_seconds(root: int) -> float:
    """Processor seconds of a process, of all below it, and of those that they have waited for.

    Args:
        root: id of the process.
    """
    parent_of: dict[int, int] = {}
    ticks_of: dict[int, int] = {}
    for folder in Path("/proc").iterdir():
        if folder.name.isdecimal():
            with suppress(OSError):  # it has ended meanwhile
                fields = (folder / "stat").read_text().rpartition(") ")[2].split()
                parent_of[int(folder.name)] = int(fields[1])
                ticks_of[int(folder.name)] = sum(map(int, fields[11:15]))  # its own, and of those waited for
    children = defaultdict(list)
    for process, parent in parent_of.items():
        children[parent].append(process)
    total, left = 0, [root]
    while left:
        process = left.pop()
        total += ticks_of.get(process, 0)
        left += children[process]
    return total / _TICKS_PER_S


class ProcessorTime:
    """In each process that runs tests: writes a row for each test with its fixtures."""

    def __init__(self, path: Path) -> None:
        self._path = path
        # Under xdist the parent is the reaper, which waits for orphans.
        self._root = os.getppid() if "PYTEST_XDIST_WORKER" in os.environ else os.getpid()

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        began_s, began_processor_s = time.monotonic(), processor_seconds(self._root)
        try:
            return (yield)
        finally:
            row = (
                item.nodeid,
                f"{time.monotonic() - began_s:.3f}",
                f"{processor_seconds(self._root) - began_processor_s:.2f}",
            )
            with self._path.open("a", newline="") as file:  # one write of less than a page: rows do not mix
                csv.writer(file).writerow(row)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--times", metavar="CSV", help="write seconds and processor seconds of each test")


def pytest_configure(config: pytest.Config) -> None:
    if not config.getoption("--times"):
        return
    path = Path(config.getoption("--times"))  # xdist hands its workers texts alone
    if not hasattr(config, "workerinput"):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(",".join(_COLUMNS) + "\r\n")
    if not getattr(config.option, "tx", None) or hasattr(config, "workerinput"):
        config.pluginmanager.register(ProcessorTime(path.absolute()), "processor_time")


def _table(rows: list[dict[str, str]], depth: int) -> Iterator[str]:
    """Lines of tests, seconds and processor seconds by the first parts of the tests' paths."""
    sums: dict[str, list[float]] = defaultdict(lambda: [0, 0.0, 0.0])
    for row in rows:
        one = sums["/".join(row["test"].partition("::")[0].split("/")[:depth])]
        one[0] += 1
        one[1] += float(row["seconds"])
        one[2] += float(row["processor_s"])
    dearest = sorted(sums.items(), key=lambda item: -item[1][2])
    together = tuple(map(sum, zip(*sums.values(), strict=True)))
    for name, (tests, seconds, processor_s) in [*dearest[:_ROWS_SHOWN], ("together", together)]:
        yield f"{processor_s:9.1f} {seconds:9.1f} {tests:6.0f}  {name}"


def main(path: Path) -> None:
    """Prints where the time of a run went."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for depth in (2, 9):
        print("processor   seconds  tests")
        print("\n".join(_table(rows, depth)) + "\n")
    for row in sorted(rows, key=lambda row: -float(row["processor_s"]))[:_ROWS_SHOWN]:
        print(f"{float(row['processor_s']):9.1f} {float(row['seconds']):9.1f}         {row['test']}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

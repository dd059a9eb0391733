"""Reads damaged files of every format, in processes with 2 GB of memory and 20 s for each file.

    firstfix-lab fuzz_files [--format las ...] [--count 20000] [--seed 0]

A file must be read or refused with a FirstfixError. Ends with an error when a reader is ended by a signal,
takes too long or too much memory, or raises something else. The table that it prints counts all of them.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import select
import shutil
import signal
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.errors import FirstfixError
from tests.hostile_files import FORMATS, Format
from tests.wounds import wounded

MEMORY_BYTES = 2 << 30
CPU_S = 20
WALL_S = 120.0  # where others use the processors
READ, TIMEOUT = "read", "timeout"
AT_ONCE = 50  # files that one process reads, if it lives
_PRELOADED = (  # so that a process for one file starts in milliseconds
    "laspy", "lazrs", "pye57", "trimesh", "trimesh.exchange.load", "lzf", "zstandard", "sqlite3", "yaml",
    "rosbags.rosbag1", "rosbags.rosbag2", "rosbags.typesys", "firstfix.wire.scan", "firstfix.wire.query",
    "firstfix.wire.sequence", "firstfix_builder.sources.read_map",
)  # fmt: skip


@dataclass
class Counts:
    """Ends of damaged files of one format.

    Attributes:
        ends: ``read``, the code of the error, the name of the signal, ``timeout``, or of another exception.
        defects: seeds' names and numbers of those that are past a limit, or no FirstfixError.
        peak_bytes: the largest memory of a process.
        slowest_s: the longest processor time of a process.
    """

    ends: Counter[str] = field(default_factory=Counter)
    defects: list[str] = field(default_factory=list)
    peak_bytes: int = 0
    slowest_s: float = 0.0

    def to_mapping(self) -> dict[str, Any]:
        """The figures."""
        return {
            "ends": dict(self.ends.most_common()),
            "defects": self.defects,
            "peak_mb": round(self.peak_bytes / 1e6),
            "slowest_s": round(self.slowest_s, 2),
        }


def fuzz(name: str, count: int, seed: int, *, folder: Path, first: int = 0) -> Counts:
    """Read the good files of a format, and ``count`` damaged ones.

    This process reads none of them itself: a library that started threads would not survive a fork.
    """
    chosen, counts = FORMATS[name], Counts()
    good = folder / "good"
    good.mkdir()
    made = _ends([lambda: chosen.make(good)])
    assert [found.end for found in made] == [READ], made
    seeds = sorted(good.iterdir())
    for path, found in zip(seeds, _ends([partial(chosen.read, path) for path in seeds]), strict=True):
        assert found.end == READ, f"{path.name} is no good file: {found}"
    numbers = range(first, first + count)
    work = [
        partial(_read_damaged, chosen, seeds[n % len(seeds)], folder / "damaged", [seed, n]) for n in numbers
    ]
    for number, found in zip(numbers, _ends(work), strict=True):
        counts.ends[found.end] += 1
        counts.peak_bytes = max(counts.peak_bytes, found.peak_bytes)
        counts.slowest_s = max(counts.slowest_s, found.seconds)
        if found.is_defect:
            counts.defects.append(f"{seeds[number % len(seeds)].name} {number}: {found.end}")
    return counts


def _read_damaged(chosen: Format, good: Path, place: Path, seed: list[int]) -> None:
    rng = np.random.default_rng(seed)
    shutil.rmtree(place, ignore_errors=True)  # of the file before
    place.mkdir()
    path = place / good.name
    if good.is_dir():
        shutil.copytree(good, path)
        files = sorted(file for file in path.rglob("*") if file.is_file())
        target = files[rng.integers(len(files))]
    else:
        target = Path(shutil.copyfile(good, path))
    data = wounded(target.read_bytes(), rng, in_place=bool(rng.integers(2)))
    if chosen.repair is not None and rng.integers(4):
        data = chosen.repair(data)
    target.write_bytes(data)
    chosen.read(path)


@dataclass(frozen=True)
class _Found:
    """The end of one file."""

    end: str
    peak_bytes: int
    seconds: float

    @property
    def is_defect(self) -> bool:
        return not self.end.islower() or self.end in (TIMEOUT, FirstfixError.code)


def _ends(work: Sequence[Callable[[], object]]) -> Iterator[_Found]:
    """Yield how each piece of work ended. One process does ``AT_ONCE`` of them, or ends with one."""
    done = 0
    while done < len(work):
        for found in _of_a_process(work[done : done + AT_ONCE]):
            done += 1
            yield found


def _of_a_process(work: Sequence[Callable[[], object]]) -> Iterator[_Found]:
    heard, said = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            os.close(heard)
            _limit()
            for one in work:
                _allow_processor()
                os.write(said, json.dumps(_end_of(one)).encode() + b"\n")
        finally:
            os._exit(0)
    os.close(said)
    begun, is_late = 0, False
    with os.fdopen(heard, "rb", buffering=0) as lines:
        while True:
            readable, _, _ = select.select([lines], [], [], WALL_S)
            if not readable:
                is_late = True
                os.kill(child, signal.SIGKILL)
                break
            line = lines.readline()
            if not line:
                break
            begun += 1
            yield _Found(*json.loads(line))
    _, status, used = os.wait4(child, 0)
    if begun < len(work):
        ended_by = signal.Signals(os.WTERMSIG(status)) if os.WIFSIGNALED(status) else None
        in_time = not is_late and ended_by != signal.SIGXCPU
        end = (ended_by.name if ended_by else "NOTHING SAID") if in_time else TIMEOUT
        yield _Found(end, used.ru_maxrss * 1024, 0.0 if in_time else CPU_S)


def _limit() -> None:
    """Limit this process, and silence it: lazrs prints its panics."""
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)


def _allow_processor() -> None:
    """Allow ``CPU_S`` more of processor time."""
    soft = int(time.process_time()) + CPU_S + 1
    resource.setrlimit(resource.RLIMIT_CPU, (soft, resource.RLIM_INFINITY))


def _end_of(work: Callable[[], object]) -> tuple[str, int, float]:
    """Run the work. Returns ``read``, the error's code or the exception's name, the memory and the time."""
    started = time.process_time()
    try:
        work()
        end = READ
    except FirstfixError as error:
        end = error.code
    except BaseException as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        end = f"{type(error).__name__} in {Path(place.filename).name}:{place.lineno}"
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return end, peak, time.process_time() - started


def main(arguments: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="firstfix-lab fuzz_files", description="Fuzzes readers of files.")
    parser.add_argument("--format", action="append", choices=list(FORMATS), help="may be repeated")
    parser.add_argument("--count", type=int, default=1000, help="damaged files of each format")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args(arguments)
    for module in _PRELOADED:
        __import__(module)
    bad = False
    for name in chosen.format or FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            counts = fuzz(name, chosen.count, chosen.seed, folder=Path(folder), first=chosen.first)
        bad |= bool(counts.defects)
        print(json.dumps({"format": name, "count": chosen.count, **counts.to_mapping()}), flush=True)
    return 1 if bad else 0

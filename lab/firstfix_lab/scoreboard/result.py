"""The result of a suite as two files: what was run where, with its figures, and every case.

SUITE.json      ``Result`` without its cases: one line a key
SUITE.csv.gz    ``Cases``, if the suite leaves them
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

MAX_BYTES = 400_000  # of each file in the repository


class ResultTooLarge(Exception):
    """A result that does not belong into a repository."""


class UnreadableResult(Exception):
    """A result that is damaged, or in the form of another release."""


@dataclass(frozen=True)
class Cases:
    """Every case of a suite: a table.

    Attributes:
        columns: names.
        rows: a value for each column; None: there is no finite one.
    """

    columns: list[str]
    rows: list[list[str | float | None]]

    def __iter__(self) -> Iterator[dict[str, Any]]:
        return (dict(zip(self.columns, row, strict=True)) for row in self.rows)

    @classmethod
    def read(cls, path: Path) -> Cases:
        """Read a CSV file with a line of names, compressed if its name ends with ``.gz``."""
        stored = path.read_bytes()
        text = gzip.decompress(stored) if path.suffix == ".gz" else stored
        columns, *rows = csv.reader(io.StringIO(text.decode(), newline=""))
        return cls(columns, [[_value(text) for text in row] for row in rows])

    def compressed(self) -> bytes:
        """The same table in a form that ``read`` takes: the same bytes every time."""
        text = io.StringIO(newline="")
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(["nan" if value is None else value for value in row] for row in self.rows)
        return gzip.compress(text.getvalue().encode(), mtime=0)


@dataclass(frozen=True)
class Result:
    """The result of one suite.

    Attributes:
        suite: its name.
        commit: that was measured.
        measured: paths that decide the figures, and their git object ids in that commit.
        command: that measured.
        quick: True if it was a small run, which no page shows.
        began: date and time in UTC.
        seconds: that the run took.
        machine: where it ran.
        versions: of Python and packages.
        figures: as the suite gave them, with its seed.
        cases: one row a case, if the suite leaves them.
    """

    suite: str
    commit: str
    measured: Mapping[str, str]
    command: str
    quick: bool
    began: str
    seconds: float
    machine: Mapping[str, Any]
    versions: Mapping[str, str]
    figures: Any
    cases: Cases | None = None

    @property
    def measured_at(self) -> str:
        """Commit and date, as pages say them."""
        return f"`{self.commit[:8]}`, {self.began[:10]}"

    @property
    def run_s(self) -> float:
        """Seconds that the run took; of its parts together where it was interrupted and gone on with."""
        return self.parts_s or self.seconds

    @property
    def parts_s(self) -> float:
        """Seconds of a run in parts; 0: it was none."""
        worlds = self.figures.get("worlds", {}) if self.suite == "robust" else {}
        return sum(world["seconds"] for world in worlds.values() if isinstance(world, dict))

    @classmethod
    def load(cls, folder: Path, suite: str) -> Result | None:
        """The result of a suite; None: there is none.

        Raises:
            UnreadableResult: it is damaged, or in another form.
        """
        path, cases = folder / f"{suite}.json", _cases_file(folder, suite)
        if not path.exists():
            return None
        try:
            return cls(**json.loads(path.read_text()), cases=Cases.read(cases) if cases.exists() else None)
        except (TypeError, ValueError, EOFError, OSError) as error:
            raise UnreadableResult(f"{path.name}: {error}") from error

    def save(self, folder: Path) -> int:
        """Write the files, in place of older ones, and return their bytes.

        Raises:
            ResultTooLarge: one has more than MAX_BYTES. Nothing is written.
        """
        about = {name: value for name, value in vars(self).items() if name != "cases"}
        text = "{" + ",\n".join(f'"{name}":{_compact(value)}' for name, value in about.items()) + "}\n"
        files = {folder / f"{self.suite}.json": text.encode()}
        if self.cases is not None:
            files[_cases_file(folder, self.suite)] = self.cases.compressed()
        for path, content in files.items():
            if len(content) > MAX_BYTES:
                raise ResultTooLarge(f"{path.name}: {len(content)} bytes, at most {MAX_BYTES} are kept")
        self.remove(folder, self.suite)
        folder.mkdir(parents=True, exist_ok=True)
        for path, content in files.items():
            path.write_bytes(content)
        return sum(map(len, files.values()))

    @staticmethod
    def remove(folder: Path, suite: str) -> None:
        """Remove the result of a suite, if there is one."""
        for path in (folder / f"{suite}.json", _cases_file(folder, suite)):
            path.unlink(missing_ok=True)


def _cases_file(folder: Path, suite: str) -> Path:
    return folder / f"{suite}.csv.gz"


def _compact(value: object) -> str:
    return json.dumps(_finite(value), separators=(",", ":"), ensure_ascii=False)


def _finite(value: Any) -> Any:
    """The value with None in place of numbers that JSON does not have."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: _finite(one) for name, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(one) for one in value]
    return value


def _value(text: str) -> str | float | None:
    try:
        number = float(text)
    except ValueError:
        return text
    return number if math.isfinite(number) else None

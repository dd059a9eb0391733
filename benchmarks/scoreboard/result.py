"""The result of a suite as a file: what was run where, its figures, and every case."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

MOST_BYTES = 400_000  # of a result in the repository


class ResultTooLarge(Exception):
    """A result that does not belong into a repository."""


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
        """Reads a CSV file with a line of names."""
        with path.open(newline="") as file:
            columns, *rows = csv.reader(file)
        return cls(columns, [[_value(text) for text in row] for row in rows])


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

    @classmethod
    def load(cls, folder: Path, suite: str) -> Result | None:
        """Returns the result of a suite; None: there is none."""
        path = folder / f"{suite}.json"
        if not path.exists():
            return None
        found = json.loads(path.read_text())
        if found["cases"] is not None:
            found["cases"] = Cases(**found["cases"])
        return cls(**found)

    def save(self, folder: Path) -> Path:
        """Writes ``SUITE.json``: one line a key and a case, so that a diff shows what has changed.

        Raises:
            ResultTooLarge: it has more than MOST_BYTES.
        """
        text = self._text()
        if len(text) > MOST_BYTES:
            raise ResultTooLarge(f"{self.suite}: {len(text)} bytes, at most {MOST_BYTES} are kept")
        folder.mkdir(parents=True, exist_ok=True)
        path = folder / f"{self.suite}.json"
        path.write_text(text)
        return path

    def _text(self) -> str:
        lines = []
        for name, value in asdict(self).items():
            shown = _compact(value)
            if name == "cases" and value is not None:
                rows = ",\n".join(map(_compact, value["rows"]))
                shown = f'{{"columns":{_compact(value["columns"])},"rows":[\n{rows}\n]}}'
            lines.append(f'"{name}":{shown}')
        return "{" + ",\n".join(lines) + "}\n"


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

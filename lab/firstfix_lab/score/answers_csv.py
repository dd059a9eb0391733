"""Reader for CASES.csv and ANSWERS.csv: true poses, and what any system answered."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from firstfix.errors import MalformedData
from firstfix.transform import Matrix, from_quaternion, pose_error
from firstfix_cli.poses_csv import POSE_COLUMNS, csv_lines

from .scored import Scored

ANSWER_COLUMNS = ("scan", *POSE_COLUMNS)
TRUE, FALSE = ("1", "true", "yes"), ("0", "false", "no")
NORM_OFF = 0.01  # of a quaternion from 1: more is no rounding


def score(cases: Path, answers: Path) -> list[Scored]:
    """Scores every case. A case without a row among the answers has no answer.

    Raises:
        NotFound: no such file.
        MalformedData: a column is missing or holds a bad value, a scan is named twice, or an answer is to a
            scan that is no case. The message names file, row and column.
    """
    truth: dict[str, Matrix | None] = {}
    for row in _rows(cases):
        truth[row.new_scan(truth)] = row.pose()
    if not truth:
        raise MalformedData(f"{cases}: the file has no cases")
    found: dict[str, Scored] = {}
    for row in _rows(answers):
        scan = row.new_scan(found)
        if scan not in truth:
            raise row.error("scan", f"{scan!r} is no case of {cases}")
        found[scan] = _scored(row, truth[scan])
    return [found.get(scan, Scored(T is not None)) for scan, T in truth.items()]


class _Row:
    """A row of a CSV file, whose errors name it."""

    def __init__(self, path: Path, number: int, values: Mapping[str, str]) -> None:
        self._path, self._number, self._values = path, number, values

    def error(self, column: str, text: str) -> MalformedData:
        return MalformedData(f"{self._path}, row {self._number}, column {column}: {text}")

    def text(self, column: str) -> str:
        return (self._values.get(column) or "").strip()

    def new_scan(self, known: Mapping[str, object]) -> str:
        """The name of the scan, which no row before has."""
        scan = self.text("scan")
        if not scan:
            raise self.error("scan", "the scan has no name")
        if scan in known:
            raise self.error("scan", f"{scan!r} is named twice")
        return scan

    def number(self, column: str, least: float = -math.inf, most: float = math.inf) -> float | None:
        """A finite number within limits; None: the cell is empty."""
        text = self.text(column)
        if not text:
            return None
        try:
            value = float(text)
        except ValueError:
            raise self.error(column, f"must be a number, not {text!r}") from None
        if not math.isfinite(value):
            raise self.error(column, f"must be finite, not {text}")
        if not least <= value <= most:
            raise self.error(column, f"must lie in {least:g}..{most:g}, not {text}")
        return value

    def flag(self, column: str) -> bool | None:
        """True or False; None: the cell is empty."""
        text = self.text(column).lower()
        if text and text not in TRUE + FALSE:
            raise self.error(column, f"must be 1 or 0, not {text!r}")
        return text in TRUE if text else None

    def pose(self) -> Matrix | None:
        """(4, 4) T_map_sensor; None: all seven cells are empty."""
        values = [self.number(column) for column in POSE_COLUMNS]
        if all(value is None for value in values):
            return None
        for column, value in zip(POSE_COLUMNS, values, strict=True):
            if value is None:
                raise self.error(column, "is empty, but the pose has other numbers")
        numbers = [value for value in values if value is not None]
        if abs(np.linalg.norm(numbers[3:]) - 1.0) > NORM_OFF:
            raise self.error("qx,qy,qz,qw", "must be a quaternion of length 1")
        return from_quaternion(numbers[:3], numbers[3:])


def _scored(row: _Row, T_map_true: Matrix | None) -> Scored:
    T_map_sensor = row.pose()
    accepted = row.flag("accepted")
    if T_map_sensor is None and accepted:
        raise row.error("accepted", "an answer without a pose cannot be accepted")
    confidence, time_s = row.number("confidence", 0.0, 1.0), row.number("time_s", 0.0)
    if T_map_sensor is None:
        return Scored(T_map_true is not None, confidence=confidence, time_s=time_s)
    error = (np.inf, np.inf) if T_map_true is None else pose_error(T_map_true, T_map_sensor)
    return Scored(T_map_true is not None, *error, True, accepted is not False, confidence, time_s)


def _rows(path: Path) -> Iterator[_Row]:
    """Rows below the line of names; the first has number 2, as editors count."""
    reader = csv.reader(csv_lines(path), skipinitialspace=True)
    names = [name.strip() for name in next(reader, [])]
    if missing := [name for name in ANSWER_COLUMNS if name not in names]:
        raise MalformedData(f"{path}: the first line has no column {', '.join(missing)}")
    for values in reader:
        if not values:
            continue
        if len(values) != len(names):
            raise MalformedData(
                f"{path}, row {reader.line_num}: {len(values)} cells under {len(names)} column names"
            )
        yield _Row(path, reader.line_num, dict(zip(names, values, strict=True)))

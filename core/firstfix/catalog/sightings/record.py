"""Record of sightings: tallies by day, as one object in the store."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date, datetime
from typing import Any

import numpy as np

from ...engine.changes.areas import newest_first
from ...engine.changes.cells import CELL_M, SLOTS, SPOT_M
from ...engine.changes.tally import KINDS, Tally
from ...store.json_record import record_json, text_of, texts_of, whole_number_of

FORMAT = 2
MAX_ROWS = 2_000_000  # of all days of a record together
_DTYPES = ("<i8", "u1", "<u4")  # of cell, slot and counts
_ROW_BYTES = 8 + 1 + 4 * len(KINDS)


@dataclass(frozen=True)
class Day:
    """Sightings of one day (UTC).

    Attributes:
        first_time, last_time: UTC, ISO 8601, of the first and the last part that was counted.
    """

    tally: Tally
    first_time: str
    last_time: str

    def plus(self, other: Day) -> Day:
        """Sum of two."""
        return Day(
            Tally.sum([self.tally, other.tally]),
            min(self.first_time, other.first_time),
            max(self.last_time, other.last_time),
        )


@dataclass(frozen=True)
class SightingsRecord:
    """Sightings by day.

    Attributes:
        days: by ISO date.
        parts: names of the objects that are summed up in this one.
    """

    days: Mapping[str, Day]
    parts: tuple[str, ...] = ()

    def plus(self, others: Iterable[tuple[str, SightingsRecord]]) -> SightingsRecord:
        """Sum with other records, which come with their names."""
        days, parts = dict(self.days), list(self.parts)
        for name, other in others:
            parts.append(name)
            for day, found in other.days.items():
                days[day] = days[day].plus(found) if day in days else found
        return SightingsRecord(days, tuple(parts))

    def newest_first(self) -> Tally:
        """Sum of all days, in which each cell has only as many old sightings as it needs."""
        return newest_first([self.days[name].tally for name in sorted(self.days, reverse=True)])

    def since(self, day: str, max_rows: int = MAX_ROWS) -> SightingsRecord:
        """The days from this one on; of too many rows the newest days."""
        kept: dict[str, Day] = {}
        rows = 0
        for name in sorted((name for name in self.days if name >= day), reverse=True):
            rows += len(self.days[name].tally)
            if rows > max_rows:
                break
            kept[name] = self.days[name]
        return SightingsRecord(kept, self.parts)

    def to_json(self) -> bytes:
        """Content of the object."""
        days = {
            name: {
                "first_time": day.first_time,
                "last_time": day.last_time,
                "sightings": day.tally.sightings,
                "rows": len(day.tally),
                "columns": _packed(day.tally),
                "coverage_known": day.tally.coverage_known,
            }
            for name, day in self.days.items()
        }
        values = {"format": FORMAT, "grid": _GRID, "days": days, "parts": list(self.parts)}
        return record_json(values)

    @classmethod
    def parse(cls, record: dict[str, Any]) -> SightingsRecord:
        """Parse a record.

        Raises:
            ValueError, KeyError, TypeError: it is no such record, or its cells are those of another release.
        """
        if record["format"] != FORMAT or record["grid"] != _GRID:
            raise ValueError("its format or its cells are not those of this release")
        if sum(whole_number_of(day, "rows") for day in record["days"].values()) > MAX_ROWS:
            raise ValueError(f"it has over {MAX_ROWS} rows")
        days = {}
        for name, day in record["days"].items():
            date.fromisoformat(name)
            times = [text_of(day, key) for key in ("first_time", "last_time")]
            for time in times:
                if datetime.fromisoformat(time).tzinfo is None:
                    raise ValueError("a time has no zone")
            days[name] = Day(_tally_of(day), *times)
        return cls(days, tuple(texts_of(record, "parts")))

    @classmethod
    def of(cls, tally: Tally, time: datetime) -> SightingsRecord:
        """Record of the counts until a time, UTC."""
        return cls({time.date().isoformat(): Day(tally, time.isoformat(), time.isoformat())})


EMPTY = SightingsRecord({})
_GRID = {"cell_m": CELL_M, "spot_m": SPOT_M, "slots": SLOTS}


def _packed(tally: Tally) -> str:
    """The columns of a tally as text. Differences of sorted keys are small: they pack well."""
    columns = np.diff(tally.cell, prepend=0), tally.slot, tally.counts.T
    return _text(
        b"".join(
            np.ascontiguousarray(column, dtype).tobytes()
            for column, dtype in zip(columns, _DTYPES, strict=True)
        )
    )


def _tally_of(day: Mapping[str, Any]) -> Tally:
    """The tally of a day in a record.

    Raises:
        ValueError, KeyError, TypeError: it is something else, or has another number of rows.
    """
    rows = day["rows"]
    data = _bytes_of(text_of(day, "columns"), rows * _ROW_BYTES)
    cell = np.cumsum(np.frombuffer(data, "<i8", rows))
    slot = np.frombuffer(data, np.uint8, rows, 8 * rows)
    counts = np.frombuffer(data, "<u4", len(KINDS) * rows, 9 * rows).reshape(len(KINDS), rows).T.copy()
    sightings, coverage_known = whole_number_of(day, "sightings"), whole_number_of(day, "coverage_known")
    tally = Tally(sightings, cell, slot.copy(), counts, coverage_known)
    tally.check()
    return tally


def _text(data: bytes) -> str:
    return base64.b64encode(zlib.compress(data, 6)).decode("ascii")


def _bytes_of(text: str, count: int) -> bytes:
    """Parse what ``_text`` made.

    Raises:
        ValueError: it is something else, or has not so many bytes.
    """
    unpacker = zlib.decompressobj()
    try:
        data = unpacker.decompress(base64.b64decode(text, validate=True), count + 1)
    except zlib.error as error:
        raise ValueError(f"its columns cannot be unpacked: {error}") from None
    if len(data) != count:
        raise ValueError("its columns have another length than its rows")
    return data

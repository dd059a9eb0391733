"""Known aliases: for each template the places elsewhere in the map that look most like its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import native
from ..array_file import check_numbers, map_arrays, save_arrays

FILE = "aliases.safetensors"
NONE = -1  # in place of a row, where a template has fewer aliases
_TURNS, _SCORES = 256, 255  # steps of a full turn, and of a score from 0 to 1


@dataclass(frozen=True)
class AliasTable:
    """Aliases of n templates, at most a for each, most similar first.

    Attributes:
        row: (n, a) int32, the aliases; NONE where there are no more.
        turn: (n, a) uint8, heading in the alias at which it looks like the template, in 1/256 of a turn.
        score: (n, a) uint8, similarity of the two, in 1/255.
    """

    row: NDArray[np.int32]
    turn: NDArray[np.uint8]
    score: NDArray[np.uint8]

    @classmethod
    def none(cls, templates: int, each: int) -> AliasTable:
        """A table to fill, of templates with ``each`` aliases at most."""
        shape = (templates, each)
        return cls(np.full(shape, NONE, np.int32), np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))

    def put(
        self,
        template: int,
        row: NDArray[np.integer],
        yaw_rad: NDArray[np.floating],
        score: NDArray[np.floating],
    ) -> None:
        """Enters the (k,) aliases of a template, most similar first; scores are 0..1."""
        count = len(row)
        self.row[template, :count] = row
        self.turn[template, :count] = np.rint(yaw_rad * (_TURNS / (2 * math.pi))).astype(np.int64) % _TURNS
        self.score[template, :count] = np.rint(np.clip(score, 0, 1) * _SCORES)

    def of(
        self, templates: NDArray[np.integer]
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """All aliases of (k,) templates, most similar first.

        Returns:
            (m,) templates that have them, (m,) rows of the aliases, (m,) yaw of the template's scan in the
            alias's frame in radians, and (m,) score, 0..1.
        """
        return self.tables.of(templates.astype(np.int64))

    @cached_property
    def tables(self) -> native.AliasTable:
        """The table as the compiled search reads it."""
        return native.AliasTable(self.row, self.turn, self.score)

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def save(self, directory: Path) -> None:
        """Write a version's file."""
        save_arrays(directory / FILE, {field.name: getattr(self, field.name) for field in fields(self)})

    @classmethod
    def load(cls, directory: Path, templates: int) -> AliasTable | None:
        """Read a version's file, memory-mapped; None: the version has none.

        Args:
            directory: of the version's files.
            templates: how many the version has.

        Raises:
            ValueError, TypeError, OSError: the file is damaged, or does not fit the templates.
        """
        if not (directory / FILE).exists():  # a provisional version
            return None
        table = cls(**map_arrays(directory / FILE))
        shape = table.row.shape
        if len(shape) != 2 or len(table.row) != templates:
            raise ValueError(f"{FILE} does not have a row for each of {templates} templates")
        for field, dtype in (("row", np.int32), ("turn", np.uint8), ("score", np.uint8)):
            array = getattr(table, field)
            if array.dtype != dtype or array.shape != shape:
                raise ValueError(f"{FILE}: {field} is not {shape} of {np.dtype(dtype)}")
        check_numbers(f"{FILE}: row", table.row - NONE, templates - NONE)
        return table

"""Changes of a map version in JSON, in pieces from which every answer about them is put together."""

from __future__ import annotations

from dataclasses import dataclass

from firstfix.catalog.sightings.changes import changes_of
from firstfix.catalog.sightings.record import SightingsRecord

from .schema.changes import ChangedArea, ChangesGrid, MapChanges
from .schema.parameters import MAX_LIMIT


@dataclass(frozen=True)
class EncodedChanges:
    """Changes in encoded pieces: an answer of any length, with cells or without, only joins them.

    Attributes:
        head: an object of all that comes before the areas.
        areas: one object each, without its cells.
        areas_with_cells: the same with its cells.
        grid: an object.
    """

    head: bytes
    areas: tuple[bytes, ...]
    areas_with_cells: tuple[bytes, ...]
    grid: bytes

    @classmethod
    def of(cls, map_id: str, version: str, record: SightingsRecord) -> EncodedChanges:
        """The changes that a record shows."""
        found = changes_of(record, limit=MAX_LIMIT, with_cells=True, with_grid=True)
        model = MapChanges.model_validate({"map_id": map_id, "version": version, **found})
        assert model.grid is not None
        return cls(
            _json(model, {"areas", "grid"}),
            tuple(_json(area, {"cell_list"}) for area in model.areas),
            tuple(_json(area) for area in model.areas),
            _json(model.grid),
        )

    @property
    def size_bytes(self) -> int:
        """Length of all pieces."""
        return sum(map(len, (self.head, self.grid, *self.areas, *self.areas_with_cells)))

    def json(self, limit: int, *, with_cells: bool, with_grid: bool) -> bytes:
        """The answer with so many of the areas."""
        areas = (self.areas_with_cells if with_cells else self.areas)[:limit]
        pieces = [self.head[:-1], b',"areas":[', b",".join(areas), b"]"]
        if with_grid:
            pieces += [b',"grid":', self.grid]
        return b"".join([*pieces, b"}"])


def _json(model: MapChanges | ChangedArea | ChangesGrid, but: set[str] | None = None) -> bytes:
    return model.model_dump_json(exclude_unset=True, exclude=but).encode()

"""Changes of a map, as ``/maps/{map_id}/changes`` tells them."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, Field

Corner = tuple[float, float, float]
Cell = tuple[int, int, int]


class Box(BaseModel):
    """A box along the axes of the map's frame."""

    low: Corner = Field(description="lowest corner, metres")
    high: Corner = Field(description="highest corner, metres")


class ChangedArea(BaseModel):
    """A connected group of cells of one kind."""

    kind: Literal["gone", "new", "unmapped"] = Field(
        description="gone: mapped surfaces have left; new: there is something that the map has not, and the "
        "mapping run saw the place free; unmapped: there is something, and it never saw the place. "
        "Where nobody knows what it saw (see `coverage_known`), all that the map has not is new"
    )
    box: Box
    cells: int = Field(description="number of cells")
    share: float = Field(description="0..1, of the spots that see a cell and say so; mean over the cells")
    spots: int = Field(description="spots from which one of its cells was seen, at most 32 are told apart")
    sightings: int = Field(description="queries that say so, of the cell that has most")
    against: int = Field(description="queries that say otherwise, of the same cell")
    first_seen: str = Field(description="UTC, ISO 8601: first count on the first day with such a query")
    last_seen: str = Field(description="UTC, ISO 8601: last count on the last day with such a query")
    cell_list: list[Cell] | None = Field(
        None, description="cells, up to 10,000: cell (i, j, k) begins at (i, j, k) times `cell_m`"
    )


class ChangesGrid(BaseModel):
    """Counts of queries by cell: the i-th number of each list belongs to the i-th cell."""

    cells_found: int = Field(description="number of all cells, also those left out")
    cells: list[Cell] = Field(description="those with most queries against the map first")
    confirmed: list[int] = Field(description="queries that met the mapped surface of the cell")
    contradicted: list[int] = Field(description="queries that saw through a part of this surface")
    unexplained: list[int] = Field(description="queries with returns that the map does not explain")
    free: list[int] = Field(description="queries that saw through the cell, once something was not explained")
    unmapped: list[int] = Field(
        description="of the queries with such returns, those that saw them where the mapping run never saw"
    )


class MapChanges(BaseModel):
    """Changes since a version of a map was made, and parts that it lacks, as the queries show them."""

    map_id: str
    version: str
    cell_m: float = Field(description="edge of a cell, metres")
    sightings: int = Field(description="number of queries that were counted")
    coverage_known: int = Field(
        description="of these, those that tell unmapped areas from new ones; 0: nobody knows where the "
        "mapping run saw, because the version has no trajectory"
    )
    seen_cells: int = Field(description="number of cells about which they tell something")
    first_time: str | None = Field(description="UTC, ISO 8601, of the first count; null: there is none")
    last_time: str | None = Field(description="UTC, ISO 8601, of the last count; null: there is none")
    areas_found: int = Field(description="number of areas, also those beyond `limit`")
    areas: list[ChangedArea] = Field(description="the largest first, the unmapped ones after the others")
    grid: ChangesGrid | None = None

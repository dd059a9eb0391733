"""Views of a changed surface by the rays that may meet the change, and no others.

Every ray that ends within what has changed is among them. A ray that meets unchanged surface first ends where
it did before, and tells nothing that the version before does not know.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firstfix.native import SeenSurface
from firstfix.sensor import SensorModel

from ..execution.chunks import Arrays
from ..execution.local_executor import in_turn
from ..mesh.places.surface_cells import rows_in
from ..simulation.changed_surface import ChangedSurface
from ..simulation.simulate import Simulator, upright
from .kept_surface import KeptSurface
from .seen_voxels import seen_voxels
from .views import AT_ONCE, REACHES, STEP_M, ViewsChunk, rays_of, view_chunks


def changed_views(
    positions: NDArray[np.floating],
    kept: KeptSurface,
    sensor: SensorModel,
    mesh: Path,
    check: Callable[[], None] = lambda: None,
) -> Iterator[Arrays]:
    """Yield results as those of ``view_chunks``, with the returns alone that the version before lacks.

    From viewpoints that it had these are the rays that may meet the change; from others all.

    Args:
        positions: (n, 3) of the templates.
        kept: the surface before.
        mesh: folder of the finished stage.
        check: called before each chunk; it may raise.
    """
    change = kept.change
    chunks = [
        (chunk, is_new)
        for chunk, is_new in _told_new(view_chunks(positions, sensor), view_chunks(kept.seen_from, sensor))
        if is_new.any() or change.is_within(chunk.places, chunk.reach_m)
    ]

    def seen(one: tuple[ViewsChunk, NDArray[np.bool_]]) -> NDArray[np.void]:
        check()
        return _seen_anew(*one, change, mesh)

    for _, voxels in in_turn(seen, chunks):
        yield {"voxels": voxels}


def _seen_anew(
    chunk: ViewsChunk, is_new: NDArray[np.bool_], change: ChangedSurface, mesh: Path
) -> NDArray[np.void]:
    """The voxels that a chunk's viewpoints see by the rays of ``changed_views``."""
    simulator: Simulator = chunk.simulator(mesh)
    rays, places = rays_of(chunk.sensor), chunk.places
    cut = replace(chunk.sensor, max_range_m=chunk.reach_m)
    surface = SeenSurface(STEP_M)
    for start in range(0, len(places), AT_ONCE):
        some = np.ascontiguousarray(places[start : start + AT_ONCE])
        new = is_new[start : start + AT_ONCE]
        met = np.ones((len(some), len(rays)), np.bool_)
        met[~new] = change.met_by(some[~new], rays, chunk.reach_m)
        facing = np.logical_or.reduce(met, axis=0)
        if not facing.any():
            continue
        cast, met = rays.of_rows(facing), met[:, facing]
        for ranges in simulator.ranges(upright(some), cut, cast):
            ranges[~met[: len(ranges)] | (ranges <= chunk.reach.beyond_m)] = np.inf
            surface.add(some[: len(ranges)], cast.directions, ranges)
            some, met = some[len(ranges) :], met[len(ranges) :]
    return seen_voxels(surface.means(), STEP_M)


def _told_new(
    chunks: Sequence[ViewsChunk], before: Sequence[ViewsChunk]
) -> Iterator[tuple[ViewsChunk, NDArray[np.bool_]]]:
    """Yield each chunk, and which of its viewpoints are none of a chunk before with the same reach."""
    for reach in REACHES:
        some = [chunk for chunk in chunks if chunk.reach == reach]
        known = _bits([chunk for chunk in before if chunk.reach == reach])
        starts = np.cumsum([len(chunk.viewpoints) for chunk in some])[:-1]
        yield from zip(some, np.split(~rows_in(_bits(some), known), starts), strict=True)


def _bits(chunks: Sequence[ViewsChunk]) -> NDArray[np.int64]:
    """(k, 3) bits of the viewpoints of chunks."""
    places = np.concatenate([np.zeros((0, 3), np.float32), *(chunk.places for chunk in chunks)])
    return places.view(np.int32).astype(np.int64)

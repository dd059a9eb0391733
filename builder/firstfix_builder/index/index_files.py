"""Writes the files that queries search and compare with, from the templates and the map."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import TemporaryFile

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import Descriptor
from firstfix.engine.config import EngineConfig
from firstfix.engine.index import MAP_FILE, MapView
from firstfix.engine.made_of import Arrays, MadeOf, always
from firstfix.engine.registration.align import MapSurface
from firstfix.engine.registration.surface import Surface
from firstfix.engine.retrieval.cascade import Cascade, Clusters, Templates, load_projection
from firstfix.engine.retrieval.key_search import build_key_search
from firstfix.engine.retrieval.template_tiles import TemplateTiles

from ..mesh.mapped_array import mapped_scratch
from .find_aliases import find_aliases
from .kept_aliases import KeptAliases
from .kept_surface import KeptSurface
from .top_view import draw_preview
from .visible_points import map_surface

AT_ONCE = 4096  # an eighth of a gigabyte of spectra


def make_keys(
    templates: Templates,
    rows: NDArray[np.integer],
    descriptor: Descriptor,
    projection: NDArray[np.float32] | None,
    scratch: Path,
) -> NDArray[np.float32]:
    """(n, numbers) of (n,) templates.

    Args:
        projection: (d, numbers) that keys are multiplied by, or None.
        scratch: folder of the file that they are kept in, which goes with the array.
    """
    whole: NDArray[np.float32] | None = None
    for start in range(0, len(rows), AT_ONCE):
        keys = descriptor.keys(templates.described_at(rows[start : start + AT_ONCE]))
        keys = keys if projection is None else keys @ projection
        if whole is None:
            with TemporaryFile(dir=scratch) as file:
                whole = mapped_scratch(file, np.float32, (len(rows), keys.shape[1]))
        whole[start : start + AT_ONCE] = keys
    assert whole is not None
    return whole


MAX_BESIDE = 5_000_000  # points: of a larger map, what takes memory is made one after the other
VIEWS_SHARE = 0.6  # of the stage's progress, that the views' chunks tell themselves


def write_index_files(
    directory: Path,
    cloud: NDArray[np.floating] | None,
    engine: EngineConfig,
    look: Callable[[NDArray[np.floating]], Iterable[Arrays]],
    progress: Callable[[float], None],
    *,
    provisional: bool = False,
    kept: KeptAliases | None = None,
    kept_surface: KeptSurface | None = None,
    made_of: MadeOf = always,
) -> None:
    """Key search, tiles, known aliases, surface, view and picture.

    Args:
        provisional: draw no picture, and find no aliases.
        kept: aliases of the version before; None: all are found anew.
        progress: called after all but the views with the share that is done, 0..1.
        directory: has templates, clusters and, if there is one, the keys' projection.
        cloud: (m, 3) the map's points; None: it is a mesh.
        look: returns what is seen from (n, 3) positions of templates, as results of ``views.view_chunks``, or
            of ``changed_views`` where a surface is kept.
        kept_surface: of the version before; None: the surface is made anew.
        made_of: makes parts of the surface, or takes them from an earlier build.
    """
    templates = Templates.load(directory, engine.descriptor.make())
    write_search(directory, templates, engine, provisional=provisional, kept=kept)
    looked, voxel_m = look(templates.position_m), engine.registration.map_voxel_m
    if kept_surface is None:
        surface = map_surface(cloud, looked, voxel_m, directory.parent, made_of)
    else:
        surface = kept_surface.renewed(cloud, looked, voxel_m, directory.parent)
    progress(0.7)
    write_surface(directory, surface, engine, templates, provisional=provisional, made_of=made_of)


def write_surface(
    directory: Path,
    surface: Surface,
    engine: EngineConfig,
    templates: Templates,
    *,
    provisional: bool,
    made_of: MadeOf = always,
) -> None:
    """Write the map's points, what scans are registered against, and the view of it.

    Args:
        provisional: draw no picture.
        made_of: makes the parts of tiles, or takes them from an earlier build.
    """
    with ThreadPoolExecutor(1) as beside:
        viewed = beside.submit(
            _write_view, directory, surface.points, engine, templates, made_of, provisional=provisional
        )
        if len(surface) > MAX_BESIDE:
            viewed.result()
        MapSurface.of(surface, engine.registration, made_of).save(directory)
        viewed.result()


def _write_view(
    directory: Path,
    points: NDArray[np.float32],
    engine: EngineConfig,
    templates: Templates,
    made_of: MadeOf,
    *,
    provisional: bool,
) -> None:
    MapView.of(points, engine.verification.reach_m, made_of).save(directory)
    np.save(directory / MAP_FILE, points)
    if not provisional:
        draw_preview(points, templates.position_m, directory / "preview.png")


def write_search(
    directory: Path,
    templates: Templates,
    engine: EngineConfig,
    *,
    provisional: bool,
    kept: KeptAliases | None = None,
) -> None:
    """Write the key search and the tiles of templates, of a folder that has their clusters.

    Args:
        provisional: find no aliases.
        kept: aliases of the version before; None: all are found anew.
    """
    standing = Clusters.load(directory).representative
    projection = load_projection(directory)
    keys = make_keys(templates, standing, engine.descriptor.make(), projection, directory)
    build_key_search(keys, engine.search, templates.position_m[standing]).save(directory)
    TemplateTiles.of(templates.position_m).save(directory)
    if provisional:
        return
    cascade, aliases = Cascade.load(directory, engine), engine.search.aliases
    found = find_aliases(cascade, keys, aliases) if kept is None else kept.renewed(cascade, keys, aliases)
    found.save(directory)

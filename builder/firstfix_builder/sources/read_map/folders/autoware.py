"""Autoware's divided map: tiles in one frame, which ``pointcloud_map_metadata.yaml`` lists.

    map_projector_info.yaml              how map coordinates and degrees belong together
    pointcloud_map_metadata.yaml         x_resolution, y_resolution, and NAME.pcd: [x, y] for each tile;
                                         NAME may be a path inside of the folder
    pointcloud_map.pcd/  or  pointcloud_map/   a folder with the tiles; or they lie beside the list

Autoware documentation, "Map component design"; map_loader of autoware_core 1.0.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import yaml

from firstfix.errors import MalformedData, TooLarge

from ..file_errors import naming
from ..map_data import MapData
from ..what_was_read import LeftOut, plain
from .autoware_projection import Projection, projection_of
from .joined_clouds import joined, read_clouds

METADATA, PROJECTOR = "pointcloud_map_metadata.yaml", "map_projector_info.yaml"
_FOLDERS = ("pointcloud_map.pcd", "pointcloud_map", ".")
MAX_LIST_BYTES = 1 << 20  # of some ten thousand tiles


def is_divided_map(path: Path) -> bool:
    """Whether a folder has the list of a divided map, or one of its folders."""
    return _list_of(path) is not None


def _list_of(path: Path) -> Path | None:
    places = (path / folder / METADATA for folder in (".", *_FOLDERS))
    return next((place for place in places if place.is_file()), None)


def read_divided_map(path: Path) -> MapData:
    """All listed tiles as one cloud. Those that are listed and not there are left out, and said.

    Raises:
        MalformedData: the list or a tile is damaged, or no tile is there.
        TooLarge: over the limits.
    """
    listed = _list_of(path)
    assert listed is not None
    with naming(listed):
        names = _tile_names(_yaml(listed))
    here = [path, listed.parent, *(path / folder for folder in _FOLDERS)]
    found = {name: next((at / name for at in here if _is_tile(at, name, path)), None) for name in names}
    tiles = [tile for tile in found.values() if tile is not None]
    missing = [name for name, tile in found.items() if tile is None]
    if not tiles:
        raise MalformedData(f"{METADATA} lists {len(names)} tiles, and none is there: {missing[0]}")
    unlisted = sorted(
        {file.name for tile in tiles for file in tile.parent.glob("[!.]*.pcd")}
        - {Path(name).name for name in names}
    )
    data = joined(read_clouds(tiles))
    projection, unread = _projection(path / PROJECTOR)
    read = replace(
        data.read,
        form=f"Autoware's divided map, {len(tiles)} of {len(names)} tiles",
        unit="metre",
        georeference=projection.words,
        notes=projection.notes,
        clouds=tuple(tile.name for tile in tiles),
    ).without(
        *(LeftOut(f"tile {name}", "it is listed, and not there") for name in missing),
        *(LeftOut(PROJECTOR, reason) for reason in unread),
        LeftOut("tiles", f"not listed in {METADATA}, as {unlisted[0] if unlisted else ''}", len(unlisted)),
    )
    return replace(data, read=read)


def _yaml(path: Path) -> dict[str, Any]:
    if path.stat().st_size > MAX_LIST_BYTES:
        raise TooLarge(f"over {MAX_LIST_BYTES} bytes")
    try:
        read = yaml.safe_load(path.read_bytes())
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise MalformedData(" ".join(str(error).split())[:300]) from None
    if not isinstance(read, dict):
        raise MalformedData("it lists nothing")
    return read


def _tile_names(listed: dict[str, Any]) -> list[str]:
    names = [str(name) for name in listed if str(name).lower().endswith(".pcd")]
    if not names:
        raise MalformedData("it lists no tile (NAME.pcd: [x, y])")
    for name in names:
        parts = name.split("/")
        if "\\" in name or "\0" in name or any(not part or part[0] == "." for part in parts):
            raise MalformedData(
                f"{plain(name)[:100]!r} is not the name of a tile, or a path to one inside of the folder"
            )
    return names


def _is_tile(at: Path, name: str, folder: Path) -> bool:
    """Whether a file is there; by a path only in the folder: a link on the way may lead out of it."""
    tile = at / name
    return tile.is_file() and ("/" not in name or tile.resolve().is_relative_to(folder.resolve()))


def _projection(path: Path) -> tuple[Projection, tuple[str, ...]]:
    """The file's projection; or why it cannot be read, which refuses no map."""
    if not path.is_file():
        return Projection("", ()), ()
    try:
        return projection_of(_yaml(path)), ()
    except (MalformedData, TooLarge) as error:
        return Projection("", ()), (plain(str(error)),)

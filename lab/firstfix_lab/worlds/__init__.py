"""Worlds: factories, offices, a campus, a farm and a city, generated, with maps and scans of known poses."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from firstfix.errors import InvalidOption
from firstfix_cli.sample_world.write_world import write_sample

from .city.write_city import write_city
from .make_world import LAYOUTS, NAMES, make_world

CITY_M = 400.0

__all__ = ["LAYOUTS", "NAMES", "WRITERS", "make_world", "write_city"]


def _write(name: str, directory: Path, seed: int, extent_m: float | None) -> str:
    if extent_m is not None:
        raise InvalidOption(f"only a city has an extent, and not {name!r}")
    return write_sample(make_world(name, seed=seed), directory)


def _write_city(directory: Path, seed: int, extent_m: float | None) -> str:
    city = write_city(directory, extent_m=CITY_M if extent_m is None else extent_m, seed=seed)
    return f"meshes of {city.side**2:,} blocks in {directory / 'mesh'}, with query scans"


# What ``firstfix world`` writes: the factory too, so that its last scans are of other kinds of places.
WRITERS = {**{name: partial(_write, name) for name in NAMES}, "city": _write_city}

"""Worlds of four kinds, each with its map and queries: the same arrays, byte for byte, every time."""

from __future__ import annotations

from firstfix_cli.sample_world import SAMPLE, Layout, World
from firstfix_cli.sample_world import make_world as make_one
from firstfix_cli.sample_world.make_world import place_of as place_of_one
from firstfix_cli.sample_world.place import Place

from .campus import campus
from .farm import farm
from .office import office

LAYOUTS: dict[str, Layout] = {**SAMPLE, "office": office, "campus": campus, "farm": farm}
NAMES = tuple(LAYOUTS)


def make_world(name: str, *, seed: int = 0) -> World:
    """Make a world of a kind, with scans of the other kinds as well.

    Raises:
        InvalidOption: no such world, or a negative seed.
    """
    return make_one(name, seed=seed, layouts=LAYOUTS)


def place_of(name: str, seed: int) -> Place:
    """A place of a kind, before anything is measured in it."""
    return place_of_one(name, seed, LAYOUTS)

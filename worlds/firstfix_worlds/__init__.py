"""Sample worlds: generated places, maps of them as a SLAM would make, and scans with known poses."""

from .city.write_city import write_city
from .make_world import NAMES, World, make_world
from .query import WorldQuery
from .write_world import write_world

__all__ = ["NAMES", "World", "WorldQuery", "make_world", "write_city", "write_world"]

"""A sample world: a generated factory, a map of it as a SLAM would make, and scans with known poses."""

from .make_world import SAMPLE, Layout, World, make_world
from .query import WorldQuery
from .write_world import write_world

__all__ = ["SAMPLE", "Layout", "World", "WorldQuery", "make_world", "write_world"]

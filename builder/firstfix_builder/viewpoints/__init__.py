"""Viewpoints on the traversable floor of the map."""

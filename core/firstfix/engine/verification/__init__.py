"""Checks of an aligned scan against the free space of the map."""

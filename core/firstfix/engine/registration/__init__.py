"""Alignment of a scan with the surface of the map, many candidates at once."""

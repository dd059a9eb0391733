"""Append-only logs of a store: the log of each map, and notices of all changes."""

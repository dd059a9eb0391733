"""Append-only logs of a store: the log of each map and the notices of all changes."""

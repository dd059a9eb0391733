"""Versions of maps: their files in the store, the cache on the local disk, and what may be removed."""

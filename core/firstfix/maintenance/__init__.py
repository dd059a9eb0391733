"""Upkeep of a store: garbage collection, verification, repair, backup, rebuild."""

"""Simulated worlds, all that goes wrong with a scan: ``python -m benchmarks.run robust``."""

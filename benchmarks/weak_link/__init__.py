"""Queries over a slow, late and lossy link: ``python -m benchmarks.weak_link``."""

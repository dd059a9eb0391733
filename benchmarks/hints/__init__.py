"""Hints of ambiguous answers, followed in simulated worlds: ``python -m benchmarks.run hints``."""

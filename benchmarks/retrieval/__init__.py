"""Templates that a scan finds before registration: ``python -m benchmarks.run retrieval``."""

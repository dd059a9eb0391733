"""Which templates a scan finds, before anything is registered: ``python -m benchmarks.run retrieval``."""

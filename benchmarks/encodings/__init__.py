"""How well a scan is answered by how it is sent: ``python -m benchmarks.run encodings``."""

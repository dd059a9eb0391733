"""Quality and size of answers for each encoding of a scan: ``python -m benchmarks.run encodings``."""

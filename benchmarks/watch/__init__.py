"""The watch over robots' own localization: ``python -m benchmarks.watch``."""

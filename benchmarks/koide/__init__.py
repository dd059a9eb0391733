"""Koide's Hard Point Cloud Localization Dataset: ``python -m benchmarks.run koide --data FOLDER``."""

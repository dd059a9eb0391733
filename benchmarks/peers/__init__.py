"""Other methods on the same maps and scans: ``python -m benchmarks.run peers``."""

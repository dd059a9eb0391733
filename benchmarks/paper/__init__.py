"""The paper's tables and figures, ours beside its own: ``python -m benchmarks.run paper``."""

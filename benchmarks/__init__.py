"""The evaluation suites (docs/method.md, BENCHMARK.md): ``python -m benchmarks.run SUITE``."""

"""Execution of stages: chunks over threads, processes or Dask, and the cache of their results."""

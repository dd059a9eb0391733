"""Processes that answer queries, and the pool that keeps them running."""

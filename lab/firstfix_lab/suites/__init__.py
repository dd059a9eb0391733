"""Suites: each measures one thing, and returns its figures."""

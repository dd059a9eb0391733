"""Shared by several suites: data sets, worlds, real servers and what they use."""

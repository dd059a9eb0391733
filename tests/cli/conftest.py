"""Fixtures of the commands' tests."""

from tests.cli.fixtures import scan, service

__all__ = ["scan", "service"]

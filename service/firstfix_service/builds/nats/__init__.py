"""Builds that are given to build workers over NATS."""

"""Connections of the HTTP server: their limits, and the address of the caller."""

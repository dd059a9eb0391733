"""Writes a map with its kept queries as a file for viewers."""

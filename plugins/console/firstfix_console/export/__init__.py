"""Writes a map with its recorded queries as a file for viewers."""

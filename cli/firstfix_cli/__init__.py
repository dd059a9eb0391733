"""The one entry point: ``firstfix``."""

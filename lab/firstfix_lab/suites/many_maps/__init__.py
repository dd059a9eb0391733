"""Thousands of maps in one store: what a replica pays for them, and what it is worth to share them out."""

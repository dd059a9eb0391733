"""Queries over a slow, late and lossy link: ``firstfix-lab weak_link``."""

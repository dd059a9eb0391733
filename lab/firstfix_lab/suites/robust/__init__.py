"""Simulated worlds, all that goes wrong with a scan: ``firstfix-lab robust``."""

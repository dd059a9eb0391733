"""Builds: queued, started, watched, cancelled."""

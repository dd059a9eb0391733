"""Builds of map versions: queued, run in processes of their own, watched and cancelled."""

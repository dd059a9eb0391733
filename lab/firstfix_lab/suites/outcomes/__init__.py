"""Lessons of many maps for every build: outcomes of scans of known truth, and scans of strange places."""

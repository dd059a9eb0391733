"""What many maps teach every build: outcomes of scans in maps of known truth, and scans of strange places."""

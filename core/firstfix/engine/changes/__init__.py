"""Changes of a map since it was made: counts by cell of what localized scans contradict, and areas."""

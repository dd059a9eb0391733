"""Files of a map index: keys, surface, visible points, preview."""

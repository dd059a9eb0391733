"""Other methods on the same maps and scans: ``firstfix-lab peers``."""

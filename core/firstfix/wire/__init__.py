"""Binary encodings of scans and queries."""

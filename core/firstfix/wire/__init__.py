"""Binary encodings of scans and queries: clients/PROTOCOL.md."""

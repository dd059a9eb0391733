"""HTTP server: its protocol, the limits of its connections, and the address of the caller."""

"""HTTP server: its protocol, and the streams of bodies and answers."""

"""Real maps and held-out scans (``suite``), and the same scans made worse (``degrade``)."""

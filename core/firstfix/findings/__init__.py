"""Findings: what is wrong or noteworthy with a scan or a map, and what helps. The texts of all codes."""

"""Findings: what is wrong or noteworthy with an input, and what helps. Texts of all codes, scans' and maps'."""

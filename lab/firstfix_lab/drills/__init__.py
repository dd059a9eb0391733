"""Fault drills: each breaks something again and again, and ends with an error when anything is lost."""

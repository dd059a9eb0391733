"""Halls whose places look alike: what a prior is worth there, and what a wrong one does."""

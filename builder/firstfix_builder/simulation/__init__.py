"""Simulated scans of a mesh with their perturbations, and sample worlds to simulate."""

"""Simulated scans of a mesh, and their perturbations."""

"""Simulated scans of a mesh with their perturbations."""

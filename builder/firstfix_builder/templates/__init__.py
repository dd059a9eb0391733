"""Templates: descriptors of simulated scans, and their clusters."""

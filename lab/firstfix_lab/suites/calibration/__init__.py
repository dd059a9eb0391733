"""Fits the prior of the calibration, and measures how well it holds in worlds that it was not fitted to."""

"""Learned keys and calibration that a build keeps of the version before, if little has changed."""

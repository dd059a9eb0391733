"""Localizing on the robot itself, without a service: the engine in a process of its own."""

"""Robots on rmw_zenoh, whose graph and topics are zenoh keys."""

"""Drivers perform the steps of a call, over HTTP or zenoh."""

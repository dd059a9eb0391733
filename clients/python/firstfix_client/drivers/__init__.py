"""Drivers: they perform the steps of a call, over HTTP or zenoh, blocking or in an event loop."""

"""Periodic tasks: removal of abandoned objects, removal of old shared stages, verification of the store."""

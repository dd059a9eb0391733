"""Checks of a map as it was read, before anything is built of it: findings, of which errors refuse it."""

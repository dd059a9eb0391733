"""Effort levels: searches of one query in one map, from narrow to exhaustive."""

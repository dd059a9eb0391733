"""Effort ladder: searches of one query in one map, from narrow to exhaustive."""

"""Uploads of large files in parts, which can be resumed on any replica."""

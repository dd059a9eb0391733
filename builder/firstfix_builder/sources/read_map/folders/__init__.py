"""Folders as mapping programs leave them: one reader a program, and one for clouds of one frame."""

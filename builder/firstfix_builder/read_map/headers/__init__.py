"""Declarations in the headers of files, compared with their size before a library believes them."""

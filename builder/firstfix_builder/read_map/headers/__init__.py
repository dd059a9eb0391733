"""What files declare about themselves, compared with their size before a library believes it."""

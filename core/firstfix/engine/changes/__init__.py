"""Changes of a map since it was made: counts of contradictions by cell, and the areas that have changed."""

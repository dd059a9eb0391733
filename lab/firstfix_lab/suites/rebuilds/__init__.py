"""Cost of a build after a part of the map has changed."""

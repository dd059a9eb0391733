"""What a build of a map costs after a part of it has changed."""

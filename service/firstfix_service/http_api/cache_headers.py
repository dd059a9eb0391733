"""Values of Cache-Control."""

# The content of a version never changes. Shared caches must not serve it: callers need permission.
FOREVER = "private, max-age=31536000, immutable"

"""Authentication of callers, their permissions and their rate limits."""

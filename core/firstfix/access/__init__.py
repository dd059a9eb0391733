"""API keys and the permissions that they grant."""

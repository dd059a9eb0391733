"""Webhooks: each answer of a wanted verdict is POSTed to the operator's URLs, signed."""

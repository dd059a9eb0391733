"""Start of the service: composes its parts, and retries while the store does not answer."""

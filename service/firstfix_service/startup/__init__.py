"""Start of the service: its parts put together, retried while the store is away."""

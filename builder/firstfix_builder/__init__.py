"""The offline side: a map becomes a published index."""

"""Telemetry: what may stand in a log, and where a request stands in a distributed trace."""

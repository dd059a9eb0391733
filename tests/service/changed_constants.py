"""Other values for constants of the service that are no settings: short times and small limits for tests."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

CONSTANTS = {
    "max_connections": "http_server.connections.MAX_CONNECTIONS",
    "max_connections_per_address": "http_server.connections.MAX_CONNECTIONS_PER_ADDRESS",
    "head_timeout_s": "http_server.connections.HEAD_TIMEOUT_S",
    "body_timeout_s": "http_server.connections.BODY_TIMEOUT_S",
    "keep_alive_s": "http_server.connections.KEEP_ALIVE_S",
    "max_open_uploads": "http_api.bodies.uploads.MAX_OPEN",
    "max_open_uploads_per_caller": "http_api.bodies.uploads.MAX_OPEN_PER_CALLER",
    "largest_files_per_caller": "http_api.bodies.uploads.LARGEST_FILES_PER_CALLER",
    "max_upload_streams": "startup.composition.MAX_UPLOAD_STREAMS",
    "max_upload_streams_per_caller": "startup.composition.MAX_UPLOAD_STREAMS_PER_CALLER",
    "max_event_streams": "startup.composition.MAX_EVENT_STREAMS",
    "max_event_streams_per_caller": "startup.composition.MAX_EVENT_STREAMS_PER_CALLER",
    "max_versions": "startup.composition.MAX_VERSIONS",
    "georeference_ttl_s": "startup.composition.GEOREFERENCE_TTL_S",
    "keys_refresh_s": "auth.authenticate.KEYS_REFRESH_S",
    "keys_max_age_s": "auth.authenticate.KEYS_MAX_AGE_S",
    "builds_per_hour": "auth.authenticate.BUILDS_PER_HOUR",
    "changes_per_min": "auth.authenticate.CHANGES_PER_MIN",
    "auth_failures_per_min": "auth.authenticate.AUTH_FAILURES_PER_MIN",
    "jwt_leeway_s": "auth.token_verifier.LEEWAY_S",
    "requests_per_s": "auth.turns.REQUESTS_PER_S",
    "max_builds_per_caller": "builds.quota.MAX_UNFINISHED",
    "build_attempts": "builds.runner.MAX_ATTEMPTS",
    "build_niceness": "builds.process.NICENESS",
    "samples_per_minute": "localize.sampler.PER_MINUTE",
    "sightings_flush_s": "query_workers.sightings.keeper.FLUSH_INTERVAL_S",
    "min_free_bytes": "startup.composition.MIN_FREE_BYTES",
}


@contextmanager
def changed_constants(changes: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Gives constants other values until the block ends. Yields the changes that are settings."""
    with ExitStack() as stack:
        for name in CONSTANTS.keys() & changes.keys():
            for place in CONSTANTS[name].split():
                stack.enter_context(patch(f"firstfix_service.{place}", changes[name]))
        yield {name: value for name, value in changes.items() if name not in CONSTANTS}

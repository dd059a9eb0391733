"""Other values for limits and constants of the service that are no settings: short times and small limits."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import fields
from typing import Any
from unittest.mock import patch

from firstfix_service.limits.limits import Limits
from firstfix_service.settings import Settings

CONSTANTS = {
    "max_versions": "startup.composition.MAX_VERSIONS",
    "georeference_ttl_s": "startup.composition.GEOREFERENCE_TTL_S",
    "keys_refresh_s": "auth.authenticate.KEYS_REFRESH_S",
    "keys_max_age_s": "auth.authenticate.KEYS_MAX_AGE_S",
    "jwt_leeway_s": "auth.token_verifier.LEEWAY_S",
    "build_attempts": "builds.runner.MAX_ATTEMPTS",
    "build_niceness": "builds.process.NICENESS",
    "recorded_per_minute": "localize.query_recorder.PER_MINUTE",
    "query_timeout_s": "startup.composition.QUERY_TIMEOUT_S",
    "sightings_flush_s": "query_workers.sightings.keeper.FLUSH_INTERVAL_S",
}
LIMITS = {one.name for one in fields(Limits)} - set(Settings.model_fields)


@contextmanager
def changed_constants(changes: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Gives limits and constants other values until the block ends. Yields the changes that are settings."""
    limits = {name: value for name, value in changes.items() if name in LIMITS}

    def limits_of(settings: Settings, open_files: int | None = None) -> Limits:
        return Limits(**limits).with_settings(settings, open_files)

    with ExitStack() as stack:
        stack.enter_context(patch.object(Limits, "of", limits_of))
        for name in CONSTANTS.keys() & changes.keys():
            stack.enter_context(patch(f"firstfix_service.{CONSTANTS[name]}", changes[name]))
        yield {name: value for name, value in changes.items() if name not in CONSTANTS and name not in LIMITS}

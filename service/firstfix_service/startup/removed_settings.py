"""Settings of earlier releases. A service or build worker that is given one does not start, and says why."""

from __future__ import annotations

import os
from collections.abc import Mapping

from firstfix.errors import InvalidOption

# What holds now, by name without FIRSTFIX_, as in docs/how-to/operate.md
REMOVED = {
    "auth_failures_per_min": "always 60",
    "body_timeout_s": "always 30 s, and the time for what came",
    "build_attempts": "always 3",
    "build_niceness": "always 10",
    "build_stall_s": "a 12th of FIRSTFIX_BUILD_TIMEOUT_S",
    "builds_per_hour": "60, or a 24th of FIRSTFIX_BUILD_MINUTES_PER_DAY if that is more",
    "cache_max_versions": "FIRSTFIX_CACHE_MAX_BYTES alone",
    "changes_per_min": "60 where other machines reach the service",
    "georeference_ttl_s": "always 5 s",
    "head_timeout_s": "always 20 s",
    "jwt_algorithms": "each algorithm with a public key, as the issuer's key says",
    "jwt_leeway_s": "always 30 s",
    "keep_alive_s": "always 75 s",
    "keys_max_age_s": "always an hour",
    "keys_refresh_s": "always 5 s",
    "max_builds_per_caller": "50 wherever FIRSTFIX_BUILD_MINUTES_PER_DAY applies",
    "max_connections": "as many as the limit of open files allows (ulimit -n), up to 4096",
    "max_connections_per_address": "always 256, and none for FIRSTFIX_TRUSTED_PROXIES",
    "max_decoded_bytes": "FIRSTFIX_MAX_BODY_BYTES",
    "max_event_streams": "always 128",
    "max_event_streams_per_caller": "always 16",
    "max_open_uploads": "always 256",
    "max_open_uploads_per_caller": "always 32",
    "max_upload_bytes_per_caller": "five times FIRSTFIX_MAX_UPLOAD_BYTES",
    "max_upload_streams": "always 16",
    "max_upload_streams_per_caller": "always 4",
    "min_free_bytes": "always 1 GiB",
    "provisional_versions": '"provisional": false in a config, or --no-provisional in FIRSTFIX_BUILD_COMMAND',
    "query_timeout_s": "always 30 s",
    "samples_below_probability": "FIRSTFIX_SAMPLES_SHARE_LOCALIZED of all localized queries",
    "samples_max_body_bytes": "always 8 MiB",
    "samples_per_minute": "always 10",
    "share_stages": "FIRSTFIX_SHARED_STAGES_MAX_BYTES: 0 for false, a size for true",
    "shared_stages_days": "always 7",
    "sightings": "always counted, at no cost to queries, unless FIRSTFIX_READ_ONLY",
    "sightings_flush_s": "always 300 s",
    "sightings_share": "always all",
    "strangers_per_s": "always 50",
    "sweep_interval_s": "60 s, and an hour for 10,000 maps",
    "upload_min_bytes_per_s": "always 1024",
    "upload_timeout_s": "always six hours for one request",
    "verify_days": "always 30",
    "worker_processes": "always processes",
    "zenoh_max_message_bytes": "one and a half times FIRSTFIX_MAX_BODY_BYTES",
}


def refuse_removed_settings(environment: Mapping[str, str] = os.environ) -> None:
    """Looks for variables of removed settings.

    Raises:
        InvalidOption: there are some; the message says for each what holds in its place.
    """
    found = [name for name in REMOVED if f"FIRSTFIX_{name.upper()}" in environment]
    if found:
        told = "; ".join(f"FIRSTFIX_{name.upper()} (now: {REMOVED[name]})" for name in found)
        raise InvalidOption(f"settings that this release does not have: {told}. Unset them")

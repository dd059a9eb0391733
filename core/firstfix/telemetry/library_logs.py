"""Logs of libraries that write what they are given: they would print secrets."""

from __future__ import annotations

import logging

# They write the URL of each request, at info, and its parts, at debug. Its path may be a secret: that of a
# webhook, or of a source. Whoever asks over HTTP tells itself what went wrong, and with which host.
SILENT = ("httpx", "httpcore")


def silence_libraries() -> None:
    """Switch these logs off, at every level. For the set-up of a process's log, never for an import."""
    for name in SILENT:
        logging.getLogger(name).setLevel(logging.CRITICAL + 1)

"""Provenance of the versions that a build on record makes."""

from __future__ import annotations

import socket
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import firstfix
from firstfix.catalog.provenance import Provenance
from firstfix.catalog.sources import sha256_of_source
from firstfix.store.sha256 import sha256_of

from .fetch_source import json_object

SUBMITTED = "POST /maps"


def provenance_of_request(request: Mapping[str, Any], source: Path) -> Provenance:
    """Provenance of what the request of a build makes of its source.

    Args:
        source: the fetched file. An upload is named by its sha256; a file from a URL is read once more.
    """
    key = json_object(request, "source").get("key")
    return Provenance(
        file_name=str(request.get("file_name") or source.name),
        size_bytes=source.stat().st_size,
        sha256=sha256_of_source(str(key)) if key else sha256_of(source),
        trajectory=str(json_object(request, "trajectory").get("file_name") or ""),
        note=str(request.get("note") or ""),
        release=firstfix.__version__,
        caller=str(request.get("owner") or ""),
        host=socket.gethostname(),
        command=str(request.get("command") or SUBMITTED),
    )

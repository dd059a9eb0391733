"""Prints the OpenAPI document: ``python -m firstfix_service.openapi > docs/openapi.json``."""

from __future__ import annotations

import json
import sys

from .app import create_app
from .settings import Settings


def document() -> str:
    """The document as it is checked in."""
    return json.dumps(create_app(Settings(store="memory://")).openapi(), indent=1, sort_keys=True) + "\n"


if __name__ == "__main__":
    sys.stdout.write(document())

from __future__ import annotations

from tests.service.fixtures import (
    catalog,
    closed,
    logging_as_before,
    logging_is_left_as_it_was,
    receiver,
    recorder,
    service,
    shared_service,
    world,
)

__all__ = [
    "catalog", "closed", "logging_as_before", "logging_is_left_as_it_was",
    "receiver", "recorder", "service", "shared_service", "world",
]  # fmt: skip

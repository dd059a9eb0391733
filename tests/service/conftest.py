from __future__ import annotations

import pytest

from tests.service.fixtures import (
    catalog,
    closed,
    logging_as_before,
    receiver,
    recorder,
    service,
    shared_service,
    world,
)

__all__ = [
    "catalog", "closed", "logging_as_before", "receiver", "recorder", "service", "shared_service", "world",
]  # fmt: skip


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "serving(**settings): of the service that a test is given")

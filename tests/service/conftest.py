from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from service_world import Service, publish, running_service


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    """A running service with a map "hall" whose version answers x = 1."""
    with running_service(tmp_path) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        yield running

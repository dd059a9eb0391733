from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.service.service_world import Service, publish, running_service


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    """A running service with a map "hall" whose version answers x = 1."""
    with running_service(tmp_path) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        yield running


@pytest.fixture(scope="module")
def shared_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """The same, one for all tests of a file: for tests that leave "hall" and the behaviour as they were."""
    with running_service(tmp_path_factory.mktemp("service")) as running:
        publish(running.catalog, "hall", "1", running.scratch)
        yield running

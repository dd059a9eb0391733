"""Fixtures of the service's tests."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import structlog

from firstfix.catalog.catalog import Catalog
from firstfix.store.store import Store
from tests.service.access_world import KEYED
from tests.service.cache_world import World
from tests.service.json_log import logging_restored
from tests.service.service_world import Service, running_service, served
from tests.service.webhook_receiver import Receiver


def _settings_of(node: pytest.Item | pytest.Collector) -> dict[str, object]:
    """Of ``serving``; what is nearer to the test counts."""
    marks = [mark.kwargs for mark in node.iter_markers("serving")]
    settings = {name: value for kwargs in reversed(marks) for name, value in kwargs.items()}
    return {**settings, "is_shared": bool(marks) and marks[0].get("is_shared", False)}


@pytest.fixture
def service(request, tmp_path) -> Iterator[Service]:
    """A running service with a map "hall" whose version answers x = 1. ``serving`` changes it."""
    settings = _settings_of(request.node)
    if settings.pop("is_shared"):
        yield request.getfixturevalue("shared_service")
        return
    with served(tmp_path, **settings) as running:
        yield running


@pytest.fixture(scope="module")
def shared_service(request, tmp_path_factory) -> Iterator[Service]:
    """The same, one for all tests of a file: for tests that leave "hall" and the behaviour as they were."""
    settings = _settings_of(request.node)
    settings.pop("is_shared")
    with served(tmp_path_factory.mktemp("service"), **settings) as running:
        yield running


@pytest.fixture
def recorder(tmp_path) -> Iterator[Service]:
    """A service that records builds and does not run them, without maps."""
    with running_service(tmp_path, zenoh=False, source_urls=("s3://maps/",)) as running:
        yield running


@pytest.fixture
def closed(tmp_path) -> Iterator[Service]:
    """A service that asks for keys, without maps."""
    with running_service(tmp_path, zenoh=False, **KEYED) as running:
        yield running


@pytest.fixture
def catalog() -> Catalog:
    """In memory."""
    return Catalog(Store.open("memory://"))


@pytest.fixture
def world(tmp_path) -> World:
    """A map cache over a directory store."""
    return World(tmp_path, Store.open(str(tmp_path / "store")))


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    running = Receiver()
    yield running
    running.close()


@pytest.fixture(autouse=True)
def logging_is_left_as_it_was() -> Iterator[None]:
    """Fails a test that leaves logs set up: tests after it would lose theirs."""
    yield
    assert not structlog.get_config()["cache_logger_on_first_use"]


@pytest.fixture
def logging_as_before() -> Iterator[None]:
    """Undoes what a test sets up for logs."""
    with logging_restored():
        yield

"""A service that is killed and restarted under few queries (``firstfix_lab.drills restart_clients``: 200)."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import numpy as np
import pytest

from firstfix.catalog.catalog import Catalog
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix_lab.checkout import ROOT
from firstfix_lab.common.programs import Replica
from firstfix_lab.drills.restart_clients import CLIENTS, replica_of, restart_under_queries
from tests.service.service_world import publish

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # replicas are started again and again

SCAN = Scan.from_points(np.random.default_rng(1).uniform(-9, 9, (300, 3)))


@pytest.fixture(scope="module")
def replica(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Replica]:
    folder = tmp_path_factory.mktemp("restarts")
    store = str(folder / "store")
    publish(Catalog(Store.open(store)), "hall", "1", folder / "made")
    command = [sys.executable, str(ROOT / "tests" / "service" / "replica_process.py")]
    with pytest.MonkeyPatch.context() as environment:
        environment.setenv("FAKE_SECONDS", "0.05")  # so that some are being worked on when it is killed
        replica = replica_of(folder / "replica", store, command)
    replica.start().wait_until_ready()
    yield replica
    replica.end()


@pytest.mark.parametrize("name", CLIENTS)
def test_no_query_is_lost_when_the_service_restarts(name: str, replica: Replica):
    before = replica.pid
    figures = restart_under_queries(replica, name, SCAN, "hall", queries=40, restarts=1, timeout_s=100.0)
    assert figures["lost"] == {}
    assert figures["queries"] == 40
    assert replica.pid != before

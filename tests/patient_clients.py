"""Clients in tests wait ten times longer for an answer than clients do: a busy machine takes its time."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

TIMEOUT_S = 100.0


@pytest.fixture(scope="session", autouse=True)
def patient_clients() -> Iterator[None]:
    from firstfix_client import AsyncClient, Client, ZenohClient

    with pytest.MonkeyPatch.context() as patch:
        for kind in (AsyncClient, Client, ZenohClient):
            patch.setitem(kind.__init__.__kwdefaults__, "timeout_s", TIMEOUT_S)
        yield

"""Fixture: maps' logs get a snapshot so often that a test needs few entries for several."""

from __future__ import annotations

import pytest

EVERY = 10  # entries from one snapshot to the next


@pytest.fixture
def frequent_snapshots(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("firstfix.catalog.log.map_log.ENTRIES_PER_SNAPSHOT", EVERY)

"""The fixture that tests of several files go on from."""

from __future__ import annotations

import pytest

from tests.builder.sources.sessions.merged_sessions import MergedSessions
from tests.once_a_run import OnceARun


@pytest.fixture(scope="session")
def two_sessions(once_a_run: OnceARun) -> MergedSessions:
    return MergedSessions.of(once_a_run.folder("two-sessions", MergedSessions.make))

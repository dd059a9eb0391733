"""kill -9 at random moments, a few of them: ``firstfix-lab kill_builds`` does 50."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix_lab.drills.kill_builds import kill_builds
from tests.nats_server import NEEDS_NATS, nats_server_program

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]  # builds are killed and begin again


@pytest.mark.parametrize("queue", ["embedded", "nats"])
def test_kills_lose_no_build_and_leave_nothing_half_done(tmp_path: Path, queue: str):
    if queue == "nats" and nats_server_program() is None:
        pytest.skip(NEEDS_NATS)
    figures = kill_builds(tmp_path, kills=6, queue=queue, seed=1)
    assert sum(figures["kills"].values()) >= 6  # kills that meet an upload come on top
    assert figures["builds_taken"] > 0
    assert figures["versions_verified"] > 0
    for name in ("not_succeeded", "broken", "published_twice", "orphans"):
        assert not figures[name], name

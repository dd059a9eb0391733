"""A stranger on the zenoh network, for a few queries: ``firstfix-lab zenoh_stranger`` asks more."""

from __future__ import annotations

from pathlib import Path

import pytest

from firstfix_lab.drills.zenoh_stranger import ROOT, WAYS, harm_in, run

pytestmark = pytest.mark.slow


def test_a_stranger_learns_and_changes_nothing(tmp_path: Path):
    table = run(ROOT, tmp_path, queries=5, false_tokens=5, late=False)
    assert harm_in(table, 5) == []
    assert all(table[way]["seen by the stranger"] for way in WAYS if way != "alone"), "he was there"
    assert table["false pose"]["false replies"]
    assert table["sent again"]["sent"]

"""The attack drill, small: a service that is attacked goes on answering another caller."""

from pathlib import Path

import pytest

from benchmarks.common.small_map import query_of
from benchmarks.hostile.attacks import ATTACKS
from benchmarks.hostile.suite import table, under_attack

pytestmark = pytest.mark.slow


def test_another_callers_queries_go_on_under_every_attack(small_version, tmp_path: Path):
    body = query_of(small_version.directory)
    figures = under_attack(small_version.directory, body, tmp_path, seconds=1.0, share=0.1)
    assert set(figures["attacks"]) == set(ATTACKS)
    for name, seen in figures["attacks"].items():
        assert seen["attackers"]["opened"] > 0, name
        assert seen["attacked"]["failures"] == [], name
        assert seen["attacked"]["queries"] > 0, name
    assert figures["failed"] == 0
    assert all(name in table(figures) for name in ATTACKS)

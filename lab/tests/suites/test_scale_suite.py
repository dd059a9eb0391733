"""Parts of the scale suite: what a build has spent, and its worlds."""

import pytest

from firstfix_lab.suites.scale.extent import EXTENTS, QUICK
from firstfix_lab.suites.scale.spent import read_cost, spent


def test_what_was_spent_before_a_kill_counts(tmp_path):
    cost = tmp_path / "stage.json"
    cost.write_text('{"seconds": 50.0, "cpu_seconds": 70.0, "peak_mb": 1000000, "peak_own_mb": 3}')
    with pytest.raises(KeyError), spent(cost):
        raise KeyError
    now = read_cost(cost)
    assert now["seconds"] >= 50
    assert now["cpu_seconds"] >= 70
    assert now["peak_mb"] == 1000000
    assert now["peak_own_mb"] > 3


def test_the_same_world_is_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        QUICK["small"].write(tmp_path / name)
    (name,) = (path.name for path in (tmp_path / "a" / "mesh").iterdir())
    assert (tmp_path / "a" / "mesh" / name).read_bytes() == (tmp_path / "b" / "mesh" / name).read_bytes()
    assert [extent.name for extent in EXTENTS.values()] == list(EXTENTS)

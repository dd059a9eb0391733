"""The scale suite on two small worlds, and the parts that no small world shows."""

from pathlib import Path

import pytest

from benchmarks.scale.build import build
from benchmarks.scale.extent import EXTENTS, QUICK
from benchmarks.scale.spent import read_cost, spent
from benchmarks.scale.suite import QUICK_SCANS, measure

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scale")


@pytest.fixture(scope="module")
def figures(work):
    return measure(QUICK, work, QUICK_SCANS)


def test_each_world_has_what_it_took_and_what_it_answers(figures):
    for world in figures["worlds"].values():
        assert world["templates"] > 100
        assert {"make_templates", "learn_keys", "build_index", "self_test"} <= world["build"].keys()
        assert all(cost["peak_mb"] >= cost["peak_own_mb"] > 0 for cost in world["build"].values())
        assert world["anywhere"]["success"]["0.2m"] >= 0.8
        assert world["with_prior"]["success"]["0.2m"] >= world["anywhere"]["success"]["0.2m"] - 0.1
        assert world["anywhere"]["false"] == 0
        assert world["after_queries"]["resident"] > world["loaded"]["own"] > 0
        for finds in world["keys"].values():
            assert finds["true_among_400"] >= 0.8
        assert world["keys"]["exact"]["of_the_nearest_400"] == 1


def test_growth_is_from_one_world_to_the_next(figures):
    (row,) = figures["growth"]
    small, larger = figures["worlds"].values()
    assert (row["from"], row["to"]) == ("small", "larger")
    assert row["templates"] == round(larger["templates"] / small["templates"], 2) > 1.5
    assert row["version"] > 1


def test_a_second_run_finds_what_the_first_made(figures, work):
    again = build(QUICK["small"], work).took
    assert again == figures["worlds"]["small"]["build"]  # to the tenth of a second


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

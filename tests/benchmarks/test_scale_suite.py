"""The scale suite on two small worlds, and the parts that no small world shows."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.scale.build import build
from benchmarks.scale.extent import EXTENTS, QUICK, Extent
from benchmarks.scale.suite import QUICK_SCANS, measure
from firstfix_builder.read_map import read_map, read_trajectory

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
        assert all(cost["peak_mb"] > 0 for cost in world["build"].values())
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


def test_the_joined_campuses_stand_side_by_side_each_another(tmp_path):
    Extent("four", 2).write(tmp_path)
    mesh = read_map(tmp_path / "mesh.ply")
    at = mesh.vertices[:, :2] + mesh.origin[:2]
    assert np.allclose([at.min(axis=0), at.max(axis=0)], [[-160, -160], [160, 160]], atol=4)
    driven = read_trajectory(tmp_path / "trajectory.txt")[:, :2, 3]
    for quarter in ((-1, -1), (-1, 1), (1, -1), (1, 1)):
        assert (driven * quarter > 0).all(axis=1).sum() > 200
    counts = [((at * quarter) > 0).all(axis=1).sum() for quarter in ((-1, -1), (-1, 1), (1, -1), (1, 1))]
    assert len(set(counts)) == 4


def test_the_same_world_is_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        QUICK["small"].write(tmp_path / name)
    for name in ("mesh.ply", "trajectory.txt"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert [extent.name for extent in EXTENTS.values()] == list(EXTENTS)

"""The retrieval suite on the small world, and its parts where the answer is known."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.worlds import BenchWorld, Scenery, WorldFiles
from benchmarks.retrieval.described_world import Asked, DescribedWorld, Known
from benchmarks.retrieval.maximum_height import MaximumHeight
from benchmarks.retrieval.recall import recall_of
from benchmarks.retrieval.report import report
from benchmarks.retrieval.suite import PIECES, Sizes, measure
from benchmarks.robust.cases import ALL
from firstfix.descriptor import LayeredOccupancy, PolarGrid, ScanBatch
from firstfix.engine.index import MapIndex
from firstfix.sensor import SensorModel
from firstfix.transform import rotation_z
from firstfix_builder.job.build_job import BuildResult
from firstfix_builder.simulation.simulate import Simulator
from small_world import CONFIG, SENSOR, SmallWorld

pytestmark = pytest.mark.slow

GRID = PolarGrid(10, 36, 20.0)


@pytest.fixture(scope="module")
def figures(small_map: Path, tmp_path_factory: pytest.TempPathFactory):
    """At 0.5 m, where 20 by key are a small part of the templates."""
    yard = BenchWorld("yard", "yard", CONFIG, lambda cache: WorldFiles(Scenery(small_map)))
    absent = replace(yard, name="absent", missing="not here")
    sizes = Sizes(queries=100, taught=300, registered=4, nearest=20)
    pieces = ("keys", "reranking", "spacing")
    return measure((yard, absent), pieces, sizes, tmp_path_factory.mktemp("retrieval"), 0.5)


def rows_of(figures, piece: str, choice: str = "") -> dict:
    """The key to the row."""
    rows = figures["worlds"]["yard"]["rows"]
    return {row["key"]: row for row in rows if row["piece"] == piece and row["choice"] == choice}


def test_a_world_that_is_not_there_is_named(figures):
    assert figures["worlds"]["absent"] == "skipped: not here"


def test_the_default_finds_its_way_about_the_yard(figures):
    assert figures["worlds"]["yard"]["templates"] > 300
    for row in rows_of(figures, "default").values():
        assert row["key_all"] >= 0.9
        assert row["best_10"] >= 0.9


def test_the_mean_occupancy_is_a_row_of_its_own(figures):
    mean_only = rows_of(figures, "coefficients", "1 in place of 8")["as it is"]
    default = rows_of(figures, "default")["as it is"]
    assert (mean_only["numbers"], default["numbers"]) == (100, 800)


def test_the_spectrum_finds_more_than_the_mean_occupancy(small_version: BuildResult, small_world: SmallWorld):
    """800 scans: of the fixture's hundred chance alone takes 3 more or fewer."""
    index = MapIndex.load(small_version.directory)
    world = DescribedWorld.of(index, Simulator(small_world.vertices, small_world.triangles))
    sensor, spectrum = SensorModel.from_mapping(SENSOR), index.cascade.descriptor
    how = {"spectrum": spectrum, "mean": replace(spectrum, coefficients=1)}
    known, asked = world.known(sensor, how), world.asked(world.scans(sensor, ALL, 800, (9,)), how)
    key_10 = {
        name: recall_of(one, known[name], asked[name], None, world.spacing_m, nearest=20).key_10
        for name, one in how.items()
    }
    assert key_10["spectrum"] > key_10["mean"] + 0.03, key_10


def test_what_is_learned_finds_more_where_templates_are_far_apart(figures):
    coarse = rows_of(figures, "spacing", "2 m")
    assert coarse["projected"]["key_10"] > coarse["as it is"]["key_10"] + 0.05


def test_shares_grow_with_what_is_looked_at(figures):
    for row in figures["worlds"]["yard"]["rows"]:
        if "numbers" in row:
            assert 0 <= row["best_10"] <= row["best_40"] <= row["key_all"] <= 1
            assert row["key_10"] <= row["key_all"]


def test_the_range_image_keeps_the_right_place_in_front(figures):
    after = rows_of(figures, "range image", "after")["projected"]
    assert after["best_1"] >= 0.8
    assert after["best_10"] >= after["best_5"] >= after["best_1"]


def test_a_coarser_grid_finds_less(figures):
    fine, coarse = (rows_of(figures, "spacing", name)["projected"] for name in ("0.5 m", "2 m"))
    assert fine["best_10"] > coarse["best_10"]


def test_the_report_has_every_row(figures):
    text = report(figures)
    rows = figures["worlds"]["yard"]["rows"]
    registered = sum("registered" in row for row in rows)
    tables = 3
    assert sum(line.startswith("| ") for line in text.splitlines()) == len(rows) + registered + tables


def test_every_piece_is_a_method():
    from benchmarks.retrieval.pieces import Pieces

    assert all(callable(getattr(Pieces, name)) for name in PIECES)


def test_maximum_height_knows_the_turn():
    rng = np.random.default_rng(3)
    points = rng.uniform([-15, -15, -1], [15, 15, 4], (4000, 3)).astype(np.float32)
    how, turn = MaximumHeight(GRID), 7 * 2 * np.pi / GRID.sectors
    here = how.describe(ScanBatch.single(points, 1.0))
    turned = how.describe(ScanBatch.single((points @ rotation_z(turn)).astype(np.float32), 1.0))
    yaw, score = how.match(turned, here, np.arange(1))
    assert yaw[0] == pytest.approx(turn)
    assert score[0] == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(how.keys(here), how.keys(turned), atol=0.02)


def test_a_right_place_at_a_wrong_heading_is_not_found():
    rng = np.random.default_rng(4)
    points = rng.uniform([-15, -15, 0], [15, 15, 4], (300, 3)).astype(np.float32)
    how = LayeredOccupancy(GRID)
    here = how.describe(ScanBatch.single(points, 1.0))
    known, first = Known(np.zeros((1, 3)), here, 1), np.zeros(1, np.intp)
    right = recall_of(how, known, Asked(first, np.full((1, 3), 0.1), np.zeros(1), here), None, 0.5)
    assert (right.key_all, right.best_10) == (1.0, 1.0)
    turned = recall_of(how, known, Asked(first, np.full((1, 3), 0.1), np.full(1, 1.0), here), None, 0.5)
    assert (turned.key_all, turned.best_10) == (1.0, 0.0)
    away = recall_of(how, known, Asked(first, np.full((1, 3), 2.0), np.zeros(1), here), None, 0.5)
    assert (away.key_all, away.best_10) == (0.0, 0.0)

"""Tables beside the templates: known aliases, and tiles of positions."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.engine.array_file import save_arrays
from firstfix.engine.retrieval.alias_table import FILE, NONE, AliasTable
from firstfix.engine.retrieval.template_tiles import FILE as TILES_FILE
from firstfix.engine.retrieval.template_tiles import TemplateTiles

TEMPLATES = 5


@pytest.fixture
def table():
    made = AliasTable.none(TEMPLATES, 3)
    made.put(0, np.array([4, 2]), np.array([0.5, 2 * math.pi - 1e-6]), np.array([0.9, 0.5], np.float32))
    made.put(1, np.array([3, 0, 4]), np.array([1.0, 2.0, 3.0]), np.array([1.0, 0.7, 0.1], np.float32))
    return made


def test_aliases_of_several_templates_come_most_similar_first(table):
    own, alias, yaw_rad, score = table.of(np.array([2, 0, 1]))
    assert own.tolist() == [1, 0, 1, 0, 1]
    assert alias.tolist() == [3, 4, 0, 2, 4]
    assert score == pytest.approx([1.0, 0.9, 0.7, 0.5, 0.1], abs=1 / 510)
    assert yaw_rad == pytest.approx([1.0, 0.5, 2.0, 0.0, 3.0], abs=math.pi / 256 + 1e-9)


def test_a_template_without_aliases_has_none(table):
    assert all(not len(part) for part in table.of(np.array([2, 3])))
    assert all(not len(part) for part in table.of(np.empty(0, np.int32)))


def test_a_loaded_table_of_aliases_is_the_same(table, tmp_path):
    assert AliasTable.load(tmp_path, TEMPLATES) is None, "a version may have none"
    table.save(tmp_path)
    again = AliasTable.load(tmp_path, TEMPLATES)
    for mine, other in zip(table.of(np.arange(5)), again.of(np.arange(5)), strict=True):
        assert np.array_equal(mine, other)


@pytest.mark.parametrize("row", [TEMPLATES, NONE - 1])
def test_rows_of_other_templates_are_refused(table, tmp_path, row):
    table.row[3, 1] = row
    table.save(tmp_path)
    with pytest.raises(ValueError, match="row has numbers"):
        AliasTable.load(tmp_path, TEMPLATES)


def test_a_table_of_other_templates_is_refused(table, tmp_path):
    table.save(tmp_path)
    with pytest.raises(ValueError, match="each of 6 templates"):
        AliasTable.load(tmp_path, TEMPLATES + 1)


@pytest.mark.parametrize(
    "changed",
    [
        {"turn": np.zeros((TEMPLATES, 2), np.uint8)},
        {"score": np.zeros((TEMPLATES, 3), np.int32)},
        {"row": np.zeros(TEMPLATES, np.int32)},
        {"row": np.zeros((TEMPLATES, 3), np.float32)},
    ],
)
def test_arrays_of_another_shape_or_type_are_refused(table, tmp_path, changed):
    save_arrays(tmp_path / FILE, {**vars(table), **changed})
    with pytest.raises(ValueError, match=FILE):
        AliasTable.load(tmp_path, TEMPLATES)


def test_a_file_without_an_array_is_refused(table, tmp_path):
    save_arrays(tmp_path / FILE, {"row": table.row, "turn": table.turn})
    with pytest.raises(TypeError):
        AliasTable.load(tmp_path, TEMPLATES)


POSITION_M = np.random.default_rng(1).uniform([-40, 10, -3], [60, 95, 8], (4000, 3)).astype(np.float32)
TILES = TemplateTiles.of(POSITION_M)
metres = st.floats(-150, 150)


@settings(max_examples=200, deadline=None, derandomize=True)
@given(metres, metres, st.floats(-10, 10), st.one_of(st.floats(0, 200), st.sampled_from([0.0, 5.0, 1e6])))
def test_within_a_sphere_are_those_whose_distance_says_so(x, y, z, radius_m):
    centre = np.array([x, y, z])
    found = TILES.within(POSITION_M, centre, radius_m)
    expected = np.flatnonzero(np.linalg.norm(POSITION_M - centre, axis=1) <= radius_m)
    assert np.array_equal(found, expected)


def test_a_template_on_the_sphere_is_within():
    at = np.array([[5.0, 0, 0], [10.0, 0, 0], [15.0, 0, 0]], np.float32)
    assert TemplateTiles.of(at).within(at, np.array([10.0, 0, 0]), 5.0).tolist() == [0, 1, 2]


@pytest.mark.parametrize("centre", [[1e9, 0, 0], [0, -1e9, 0], [-1e9, 1e9, 1e9]])
def test_a_place_however_far_off_has_an_answer(centre):
    assert len(TILES.within(POSITION_M, np.array(centre), 50.0)) == 0


def test_loaded_tiles_find_the_same(tmp_path):
    TILES.save(tmp_path)
    again = TemplateTiles.load(tmp_path, POSITION_M)
    centre = np.array([3.0, 33.0, 0.5])
    assert np.array_equal(again.within(POSITION_M, centre, 15.0), TILES.within(POSITION_M, centre, 15.0))


def test_tiles_of_other_templates_other_arrays_and_no_file_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError):
        TemplateTiles.load(tmp_path, POSITION_M)
    TILES.save(tmp_path)
    with pytest.raises(ValueError, match="4000 templates, not 3999"):
        TemplateTiles.load(tmp_path, POSITION_M[1:])
    save_arrays(tmp_path / TILES_FILE, {"row": TILES.row})
    with pytest.raises(TypeError):
        TemplateTiles.load(tmp_path, POSITION_M)

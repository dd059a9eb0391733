"""Templates near a position, compared with the distances of all."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firstfix.engine.array_file import save_arrays
from firstfix.engine.retrieval.template_tiles import FILE, TemplateTiles

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
def test_however_far_off_the_place_is_there_is_an_answer(centre):
    assert len(TILES.within(POSITION_M, np.array(centre), 50.0)) == 0


def test_what_was_saved_answers_the_same(tmp_path):
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
    save_arrays(tmp_path / FILE, {"row": TILES.row})
    with pytest.raises(TypeError):
        TemplateTiles.load(tmp_path, POSITION_M)

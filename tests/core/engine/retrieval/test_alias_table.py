"""The table of known aliases: what is put in comes out, and a damaged file is refused."""

import math

import numpy as np
import pytest

from firstfix.engine.array_file import save_arrays
from firstfix.engine.retrieval.alias_table import FILE, NONE, AliasTable

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


def test_what_was_saved_is_the_same(table, tmp_path):
    table.save(tmp_path)
    again = AliasTable.load(tmp_path, TEMPLATES)
    for mine, other in zip(table.of(np.arange(5)), again.of(np.arange(5)), strict=True):
        assert np.array_equal(mine, other)


def test_a_version_without_the_file_has_no_table(tmp_path):
    assert AliasTable.load(tmp_path, TEMPLATES) is None


@pytest.mark.parametrize("row", [TEMPLATES, NONE - 1])
def test_rows_of_no_template_are_refused(table, tmp_path, row):
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


def test_a_file_that_is_cut_off_or_lacks_an_array_is_refused(table, tmp_path):
    save_arrays(tmp_path / FILE, {"row": table.row, "turn": table.turn})
    with pytest.raises(TypeError):
        AliasTable.load(tmp_path, TEMPLATES)
    table.save(tmp_path)
    whole = (tmp_path / FILE).read_bytes()
    (tmp_path / FILE).write_bytes(whole[:-4])
    with pytest.raises(ValueError, match="cut off"):
        AliasTable.load(tmp_path, TEMPLATES)

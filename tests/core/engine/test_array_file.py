import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from safetensors.numpy import load_file

from firstfix.engine.array_file import map_arrays, save_arrays

ARRAYS = {
    "points": np.random.default_rng(1).normal(size=(7, 3)).astype(np.float32),
    "begin": np.arange(12, dtype=np.int32).reshape(3, 4),
    "known": np.array([True, False, True]),
    "exact": np.array([1 / 3, 1e300]),
    "nothing": np.empty((0, 3), np.float32),
}


def test_saved_arrays_are_mapped_as_they_were(tmp_path):
    save_arrays(tmp_path / "a", ARRAYS)
    found = map_arrays(tmp_path / "a")
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        assert np.array_equal(found[name], array)
        assert found[name].shape == array.shape
        assert not found[name].flags.writeable


def test_another_reader_of_the_format_reads_it(tmp_path):
    save_arrays(tmp_path / "a", ARRAYS)
    found = load_file(tmp_path / "a")
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        assert np.array_equal(found[name], array)


def test_pages_are_the_files_not_copies(tmp_path):
    """Processes that load the same version share its memory."""
    path = tmp_path / "a"
    save_arrays(path, {"x": np.zeros(1000, np.float32)})
    found = map_arrays(path)["x"]
    with path.open("r+b") as file:
        file.seek(-4, 2)
        file.write(np.float32(5).tobytes())
    assert found[-1] == 5


def test_the_same_arrays_give_the_same_bytes_in_any_order(tmp_path):
    save_arrays(tmp_path / "a", ARRAYS)
    save_arrays(tmp_path / "b", dict(reversed(ARRAYS.items())))
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_an_array_that_is_not_contiguous_is_saved_as_it_reads(tmp_path):
    slanted = np.arange(20, dtype=np.int32).reshape(4, 5).T[::2]
    save_arrays(tmp_path / "a", {"x": slanted})
    assert np.array_equal(map_arrays(tmp_path / "a")["x"], slanted)


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=150)
@given(cut=st.integers(1, 400), place=st.integers(0, 10_000), value=st.integers(0, 255))
def test_a_damaged_file_gives_an_error_or_arrays_that_lie_within_it(tmp_path, cut, place, value):
    path = tmp_path / "a"
    save_arrays(path, ARRAYS)
    data = bytearray(path.read_bytes())
    data[place % len(data)] = value
    path.write_bytes(data[: max(1, len(data) - cut % len(data))])
    try:
        found = map_arrays(path)
    except ValueError:
        return
    for array in found.values():
        assert array.nbytes <= len(data)
        array.sum()  # can be read


def test_a_cut_off_file_is_refused(tmp_path):
    path = tmp_path / "a"
    save_arrays(path, ARRAYS)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ValueError, match="cut off"):
        map_arrays(path)


def test_an_array_at_an_odd_place_is_refused(tmp_path):
    """A kernel reads whole numbers, which start where the processor wants them."""
    path = tmp_path / "a"
    save_arrays(path, {"x": np.arange(3, dtype=np.int32)})
    header = b'{"x":{"dtype":"I32","shape":[2],"data_offsets":[1,9]}}'
    path.write_bytes(len(header).to_bytes(8, "little") + header + path.read_bytes()[-12:])
    with pytest.raises(ValueError, match="not aligned"):
        map_arrays(path)

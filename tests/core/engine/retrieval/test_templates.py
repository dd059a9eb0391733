"""Files of templates: what was saved is loaded, and files that do not fit are refused."""

from pathlib import Path

import numpy as np
import pytest

from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.engine.retrieval.cascade import Templates
from tests.every_case import every_case

DESCRIPTOR = LayeredOccupancy(PolarGrid(2, 8, 10.0), (0.0, 1.0))


def saved(directory: Path) -> Templates:
    cells = np.arange(10, dtype=np.uint8).reshape(5, 2)
    templates = Templates(np.eye(5, 3, dtype=np.float32), np.ones(5, np.float32), {"occupancy": cells})
    templates.save(directory)
    return templates


def test_what_was_saved_is_loaded(tmp_path: Path):
    templates = saved(tmp_path)
    loaded = Templates.load(tmp_path, DESCRIPTOR)
    assert len(loaded) == 5
    assert np.array_equal(loaded.position_m, templates.position_m)
    assert np.array_equal(loaded.height_m, templates.height_m)
    assert np.array_equal(loaded.described["occupancy"], templates.described["occupancy"])


@every_case(
    ("name", "array"),
    [
        ("height_m", np.ones(4, np.float32)),
        ("occupancy", np.zeros((4, 2), np.uint8)),
        ("occupancy", np.zeros((6, 2), np.uint8)),
        ("height_m", np.float32(1)),
    ],
)
def test_a_file_with_other_rows_is_refused(tmp_path: Path, name: str, array: np.ndarray):
    saved(tmp_path)
    np.save(tmp_path / f"template_{name}.npy", array)
    with pytest.raises(ValueError, match=f"template_{name}.npy"):
        Templates.load(tmp_path, DESCRIPTOR)

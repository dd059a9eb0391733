"""Angles as fractions of a turn."""

import numpy as np
import pytest

from firstfix.bit_exact.atan2 import atan2_turns


def test_it_is_the_angle():
    rng = np.random.default_rng(0)
    y, x = rng.normal(0, 20, (2, 200_000)).astype(np.float32)
    true = np.arctan2(y.astype(np.float64), x.astype(np.float64)) / (2 * np.pi)
    assert np.abs(atan2_turns(y, x) - true).max() < 1e-7


@pytest.mark.parametrize(
    ("y", "x", "wanted"), [(0, 0, 0), (0, 2, 0), (3, 0, 0.25), (-3, 0, -0.25), (0, -1, 0.5), (1e-40, -1, 0.5)]
)
def test_the_axes_are_exact(y, x, wanted):
    assert atan2_turns(np.float32([y]), np.float32([x])) == np.float32(wanted)


def test_it_does_not_depend_on_the_processor():
    """Bits of a few angles, as clients in other languages compute them."""
    y, x = np.float32([[1, -2, 3.5, 0.1], [2, -1, -0.25, 1]])
    assert atan2_turns(y, x).view(np.uint32).tolist() == [1033314345, 3198535690, 1048956807, 1015149214]

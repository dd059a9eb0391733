import numpy as np
import pytest

from firstfix.answer.options import LocalizeOptions
from firstfix.answer.prior import Prior
from firstfix.errors import InvalidOption
from firstfix.transform import make_transform, rotation_z


def pose(x: float, yaw_deg: float = 0.0) -> np.ndarray:
    return make_transform(rotation_z(np.radians(yaw_deg)), [x, 0, 0])


def test_a_radius_allows_what_lies_in_it():
    prior = Prior(np.array([1.0, 0, 0]), 2.0)
    assert prior.allows(pose(2.9, 170))
    assert not prior.allows(pose(3.1))
    assert prior.allows(pose(3.1), slack_m=0.2)


@pytest.mark.parametrize(
    ("yaw_deg", "allowed"), [(160, True), (-170, True), (-161, True), (139, False), (0, False)]
)
def test_headings_go_round(yaw_deg, allowed):
    prior = Prior(np.zeros(3), 5.0, yaw_deg=170.0, yaw_range_deg=30.0)
    assert prior.allows(pose(0, yaw_deg)) is allowed


@pytest.mark.parametrize("text", ["1.0,2.0,3.0,4.0", "1.0,2.0,3.0,4.0,-90.0,15.0"])
def test_options_carry_it(text):
    options = LocalizeOptions.from_strings({"prior": text})
    assert options.to_strings() == {"prior": text}


@pytest.mark.parametrize(
    "text", ["1,2,3", "1,2,3,0", "1,2,3,-1", "1,2,3,nan", "1,2,3,4,5", "1,2,3,4,0,0", "1,2,3,4,0,181", "x"]
)
def test_what_is_no_prior_is_refused(text):
    with pytest.raises(InvalidOption, match="prior"):
        LocalizeOptions.from_strings({"prior": text})

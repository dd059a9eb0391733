"""Outlooks from two places, and the misfit between them."""

import numpy as np
import pytest

from firstfix.engine.hint.outlook import FieldOfView, Outlook
from firstfix.engine.index import MapView
from firstfix.scan.reduction import RangeView, directions
from firstfix.transform import make_transform, rotation_z

UP = np.array([0.0, 0, 1])


def box(centre_x, length_m):
    """Points of a room around (centre_x, 0), 6 m wide, that ends ``length_m`` ahead of its centre."""
    side, z = np.linspace(-3, 3, 60), np.linspace(0, 2.5, 26)
    along = np.arange(-3, length_m, 0.1)
    walls = [
        *((centre_x + along, np.full(len(along), y)) for y in (-3.0, 3.0)),
        (np.full(60, centre_x - 3), side),
        (np.full(60, centre_x + length_m), side),
    ]
    return np.concatenate([[(x, y, h) for x, y in zip(*wall, strict=True) for h in z] for wall in walls])


def at(x):
    return make_transform(np.eye(3), [x, 0, 1.0])


def sees(azimuth_deg=360.0):
    along = directions().astype(np.float32)
    inside = np.abs(np.degrees(np.arctan2(along[:, 1], along[:, 0]))) <= azimuth_deg / 2
    return FieldOfView.of(RangeView.of(5 * along[inside & (np.abs(along[:, 2]) < 0.26)]))


@pytest.fixture(scope="module")
def view():
    """Three rooms: two alike, and one that is longer."""
    return MapView.of(np.concatenate([box(0, 4.0), box(40, 4.0), box(80, 8.0)]), reach_m=25.0)


def test_equal_places_fit_and_others_do_not(view):
    first, twin, longer = (Outlook.at(view, at(x)) for x in (0.0, 40.0, 80.0))
    assert first.misfit(twin, sees()) < 0.005
    assert first.misfit(longer, sees()) > 0.05
    assert longer.misfit(first, sees()) > first.misfit(longer, sees()), "its scan sees through the near wall"


def test_a_sensor_that_looks_back_sees_no_difference(view):
    turned = make_transform(rotation_z(np.pi), np.zeros(3))
    first, longer = (Outlook.at(view, at(x) @ turned) for x in (0.0, 80.0))
    assert first.misfit(longer, sees(90)) < 0.005
    ahead = [Outlook.at(view, at(x)) for x in (0.0, 80.0)]
    assert ahead[0].misfit(ahead[1], sees(90)) > 0.2


def test_turning_helps_only_a_sensor_that_does_not_see_all_round():
    assert sees().is_all_round(UP)
    assert not sees(90).is_all_round(UP)


def test_nothing_mapped_is_nothing_to_compare(view):
    nowhere = Outlook.at(view, at(1000.0))
    assert nowhere.misfit(Outlook.at(view, at(0.0)), sees()) == 0.0

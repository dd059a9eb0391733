"""An unknown sensor is measured from its scans: those of every preset give the preset back."""

import numpy as np
import pytest

from firstfix.errors import InvalidScan
from firstfix.sensor import SensorModel, preset, presets
from firstfix.sensor.measure import MeasuredScan, measure_sensor
from tests.measured_room import room_scan

ROWS = [name for name in presets() if preset(name).pattern == "rows"]
ROSETTES = [name for name in presets() if preset(name).pattern == "rosette"]


def mixed_up(points, seed=1):
    """The points in any order, as a driver may send them."""
    return points[np.random.default_rng(seed).permutation(len(points))]


@pytest.mark.parametrize("name", ROWS)
def test_rows_of_every_preset_are_measured(name):
    known = preset(name)
    points, _ = room_scan(known, 3)
    found = measure_sensor([MeasuredScan("a", mixed_up(points), height_m=0.9)])
    nominal = np.sort(known.elevations_deg)
    if name == "jt128":  # two of its beams lie 0.001 degrees apart
        nominal = np.delete(nominal, 113)
    assert found.way == "elevation"
    assert len(found.sensor.elevations_deg) == len(nominal)
    np.testing.assert_allclose(found.sensor.elevations_deg, nominal, atol=0.02)
    assert found.sensor.azimuth_step_deg == pytest.approx(known.azimuth_step_deg, rel=0.02)
    assert found.sensor.azimuth_fov_deg == pytest.approx(known.azimuth_fov_deg, abs=1)
    assert found.sensor.range_noise_m == pytest.approx(0.01, abs=0.003)
    assert (found.sensor.mount_height_m, found.floor_seen, found.thinned) == (0.9, True, False)
    assert name in found.presets
    assert SensorModel.from_mapping(found.sensor.to_mapping()) == found.sensor


@pytest.mark.parametrize("name", ROSETTES)
def test_a_sensor_without_rings_is_measured_as_a_rosette(name):
    known = preset(name)
    scans = [MeasuredScan(str(moment), room_scan(known, moment, moment=moment)[0]) for moment in (0, 5)]
    found = measure_sensor(scans)
    assert found.way is None
    assert (found.sensor.pattern, found.thinned) == ("rosette", False)
    ends = min(found.sensor.elevations_deg), max(found.sensor.elevations_deg)
    assert ends == pytest.approx((min(known.elevations_deg), max(known.elevations_deg)), abs=1.5)
    assert found.sensor.azimuth_fov_deg == pytest.approx(known.azimuth_fov_deg, abs=1)
    rays = np.mean([len(scan.points) for scan in scans])
    assert len(found.sensor.scan_directions()) == pytest.approx(rays, rel=0.1)
    assert name in found.presets


def test_ring_numbers_of_the_format_are_used_if_they_are_beams():
    known = preset("hdl-32e")
    points, ray = room_scan(known, 4)
    number = np.random.default_rng(2).permutation(32)[ray // 1800]  # drivers number beams as they like
    found = measure_sensor([MeasuredScan("a", points, number)])
    assert found.way == "field"
    np.testing.assert_allclose(found.sensor.elevations_deg, known.elevations_deg, atol=0.01)
    livox, ray = room_scan(preset("avia"), 4)
    assert measure_sensor([MeasuredScan("b", livox, ray % 6)]).way is None  # six lines, which are no rings


def test_beams_of_lasers_apart_are_told_by_the_order_of_points():
    """As in KITTI's files: the elevations of beams overlap, and the rings come one after the other."""
    known = preset("hdl-64e")
    points, ray = room_scan(known, 5, lost=0)
    beam = ray // 1800
    points[:, 2] += np.where(beam % 2, 0.12, -0.12)
    order = np.lexsort((np.arctan2(points[:, 1], points[:, 0]) % (2 * np.pi), beam))
    found = measure_sensor([MeasuredScan("a", points[order])])
    assert found.way == "order"
    assert len(found.sensor.elevations_deg) == 64
    assert measure_sensor([MeasuredScan("a", mixed_up(points))]).way != "order"


def test_a_preset_is_recognized_without_some_of_its_beams():
    points, ray = room_scan(preset("os1-64"), 6)
    seen = points[ray // 1024 < 50]  # the upper beams look at the sky
    found = measure_sensor([MeasuredScan("a", seen)])
    assert len(found.sensor.elevations_deg) == 50
    assert found.presets == ("os1-64",)


def test_beams_a_little_off_are_those_of_the_preset():
    known = preset("os1-128")
    own = SensorModel.from_mapping(
        {**known.to_mapping(), "elevations_deg": [0.95 * up + 0.2 for up in known.elevations_deg]}
    )
    assert measure_sensor([MeasuredScan("a", room_scan(own, 7)[0])]).presets == ("os1-128",)


def test_an_unknown_sensor_has_no_preset():
    own = SensorModel("own", (-20.0, -9.0, -3.0, 0.0, 4.0, 6.0, 18.0), 0.5, 0.2, 80, 1.0)
    found = measure_sensor([MeasuredScan("a", room_scan(own, 8)[0])], name="own")
    assert found.presets == ()
    np.testing.assert_allclose(found.sensor.elevations_deg, own.elevations_deg, atol=0.01)
    assert found.sensor.name == "own"


def test_without_a_floor_the_height_is_the_default():
    found = measure_sensor([MeasuredScan("a", room_scan(preset("vlp-16"), 9)[0])], default_height_m=1.3)
    assert (found.sensor.mount_height_m, found.floor_seen) == (1.3, False)


def test_a_scan_thinned_by_a_grid_is_recognized():
    dense = SensorModel("dense", tuple(np.linspace(-80, 80, 400)), 0.25, 0.2, 80, 1.0)
    points, _ = room_scan(dense, 10)
    cells = np.floor(points / 0.15).astype(int)
    _, first = np.unique(cells, axis=0, return_index=True)
    jitter = np.random.default_rng(3).uniform(0, 0.15, (len(first), 3))
    thinned = (cells[first] * 0.15 + jitter).astype(np.float32)
    found = measure_sensor([MeasuredScan("a", thinned)])
    assert (found.way, found.thinned) == (None, True)


def test_too_few_points_are_refused():
    points, _ = room_scan(preset("vlp-16"), 11)
    with pytest.raises(InvalidScan, match="499 points are too few"):
        measure_sensor([MeasuredScan("a", points[:499])])
    with pytest.raises(InvalidScan, match="too few"):
        measure_sensor([MeasuredScan("a", np.zeros((5000, 3)))])  # as drivers write what did not return


def test_a_map_is_refused():
    """A house of many rooms, seen from one of them through its walls."""
    rng = np.random.default_rng(12)
    walls = rng.uniform(-20, 20, (40_000, 3)) * [1, 1, 0.1]
    walls[::2, 0] = np.round(walls[::2, 0] / 4) * 4 + 2
    walls[1::2, 1] = np.round(walls[1::2, 1] / 4) * 4 + 2
    with pytest.raises(InvalidScan, match=r"house\.pcd is no scan of one sensor"):
        measure_sensor([MeasuredScan("house.pcd", walls)])


def test_scans_of_different_sensors_are_refused():
    scans = [MeasuredScan(name, room_scan(preset(name), 13)[0]) for name in ("vlp-16", "os0-64")]
    with pytest.raises(InvalidScan, match=r"different sensors: vlp-16 has 16 rings, os0-64 has 64"):
        measure_sensor(scans)

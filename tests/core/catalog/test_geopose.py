"""Georeferences of maps, and geographic poses against independent formulas."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from firstfix.catalog.geopose import Georeference, T_ecef_enu, ecef_of, geodetic_of
from firstfix.catalog.georeferences import Georeferences
from firstfix.errors import InvalidOption, StoreError
from firstfix.store.store import Store
from firstfix.transform import from_quaternion, quaternion_of, rotation_angle_deg, rotation_z
from tests.core.fixtures import at_once

A_M, B_M = 6378137.0, 6356752.314245179
LATITUDES = st.floats(-90, 90)
LONGITUDES = st.floats(-180, 180)
HEIGHTS = st.floats(-10_000, 10_000)
METRES = st.floats(-5000, 5000)


def parametric_ecef(lat_deg: float, lon_deg: float, h_m: float) -> np.ndarray:
    """Position from the reduced latitude and the normal of the ellipse, without radius of curvature."""
    phi, lam = math.radians(lat_deg), math.radians(lon_deg)
    beta = math.atan2(B_M * math.sin(phi), A_M * math.cos(phi))
    across = A_M * math.cos(beta) + h_m * math.cos(phi)
    return np.array(
        [across * math.cos(lam), across * math.sin(lam), B_M * math.sin(beta) + h_m * math.sin(phi)]
    )


def numeric_enu(lat_deg: float, lon_deg: float, h_m: float) -> np.ndarray:
    """(3, 3) columns east, north, up: derivatives of the position by each coordinate."""
    axes = []
    for step in ((0.0, 1e-4, 0.0), (1e-4, 0.0, 0.0), (0.0, 0.0, 1.0)):
        ahead, behind = (
            parametric_ecef(*(v + sign * d for v, d in zip((lat_deg, lon_deg, h_m), step, strict=True)))
            for sign in (1, -1)
        )
        axes.append((ahead - behind) / np.linalg.norm(ahead - behind))
    return np.column_stack(axes)


def test_ecef_is_that_of_the_surveyors_example():
    """IOGP guidance note 7-2, 4.1.1 (EPSG method 9602)."""
    lat, lon = 53 + 48 / 60 + 33.820 / 3600, 2 + 7 / 60 + 46.380 / 3600
    np.testing.assert_allclose(ecef_of(lat, lon, 73.0), [3771793.968, 140253.342, 5124304.349], atol=6e-4)
    found = geodetic_of([3771793.968, 140253.342, 5124304.349])
    np.testing.assert_allclose(found, [lat, lon, 73.0], rtol=0, atol=1e-3)


@given(LATITUDES, LONGITUDES, HEIGHTS)
def test_geodetic_inverts_ecef(lat: float, lon: float, h: float):
    ecef = ecef_of(lat, lon, h)
    np.testing.assert_allclose(ecef, parametric_ecef(lat, lon, h), atol=1e-7)
    lat2, lon2, h2 = geodetic_of(ecef)
    assert lat2 == pytest.approx(lat, abs=1e-11)
    assert h2 == pytest.approx(h, abs=1e-7)
    np.testing.assert_allclose(ecef_of(lat2, lon2, h2), ecef, atol=1e-7)


@given(st.floats(-89, 89), LONGITUDES, HEIGHTS)
def test_the_tangent_frame_is_the_derivative(lat: float, lon: float, h: float):
    np.testing.assert_allclose(T_ecef_enu(lat, lon, h)[:3, :3], numeric_enu(lat, lon, h), atol=1e-6)


@given(
    st.floats(-85, 85),
    st.floats(-179, 179),
    st.floats(-180, 180),
    st.tuples(METRES, METRES, st.floats(-100, 100)),
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.1),
)
def test_a_pose_agrees_with_the_other_formulas(lat, lon, heading, position, quaternion):
    georeference = Georeference.with_heading(lat, lon, 120.0, heading, anchor_m=(7.0, -3.0, 1.0))
    T_map_body = from_quaternion(position, quaternion)
    found = georeference.geopose(T_map_body)
    local = rotation_z(math.radians(heading)) @ (np.array(position) - (7.0, -3.0, 1.0))
    R_ecef_enu = numeric_enu(lat, lon, 120.0)
    expected_ecef = parametric_ecef(lat, lon, 120.0) + R_ecef_enu @ local
    here = found["position"]
    reached = parametric_ecef(here["lat"], here["lon"], here["h"])
    np.testing.assert_allclose(reached, expected_ecef, atol=2e-5)
    # the attitude, led back to the Earth's axes through the frame at the body's own position
    turn = found["quaternion"]
    R_enu_body = from_quaternion((0, 0, 0), [turn[name] for name in "xyzw"])[:3, :3]
    R_ecef_body = numeric_enu(here["lat"], here["lon"], here["h"]) @ R_enu_body
    R_expected = R_ecef_enu @ rotation_z(math.radians(heading)) @ T_map_body[:3, :3]
    assert rotation_angle_deg(R_ecef_body.T @ R_expected) < 1e-4
    assert georeference.x_axis_deg == pytest.approx(heading, abs=1e-9) or abs(heading) == 180


def test_a_georeference_is_read_from_its_json():
    georeference = Georeference(
        1.5,
        -2.5,
        3.0,
        tuple(quaternion_of(from_quaternion((0, 0, 0), (0.1, 0.2, 0.3, 0.9)))),
        (1.0, 2.0, 3.0),
    )
    assert Georeference.from_mapping(json.loads(json.dumps(georeference.to_mapping()))) == georeference


@pytest.mark.parametrize(
    ("name", "value"),
    [
        *(("latitude_deg", value) for value in (90.1, "north")),
        ("longitude_deg", -181),
        *(("height_m", value) for value in (float("nan"), 2e5)),
        *(("quaternion", value) for value in ((0, 0, 0, 2), (0, 0, 1))),
        *(("anchor_m", value) for value in ((0, 0, 1e9), (0, float("inf"), 0), None)),
    ],
)
def test_an_invalid_georeference_is_refused(name, value):
    good = Georeference.with_heading(1, 2, 3, 4).to_mapping()
    with pytest.raises(InvalidOption):
        Georeference.from_mapping({**good, name: value})


def at(latitude_deg: float) -> Georeference:
    return Georeference.with_heading(latitude_deg, 8.0, 100.0, 0.0)


def test_the_last_georeference_counts(any_store: Store):
    georeferences = Georeferences(any_store)
    assert georeferences.get("hall") is None
    georeferences.set("hall", at(1))
    georeferences.set("hall", at(2))
    assert georeferences.get("hall") == at(2)
    assert georeferences.get("attic") is None
    georeferences.set("hall", None)
    assert georeferences.get("hall") is None
    georeferences.set("hall", at(3))
    assert georeferences.get("hall") == at(3)


def test_no_georeference_is_lost_in_a_race(any_store: Store):
    at_once(16, lambda n: Georeferences(any_store).set("hall", at(n)))
    assert len(any_store.list("maps/hall/georeference")) == 16


def test_an_unreadable_georeference_is_refused(store: Store):
    georeferences = Georeferences(store)
    georeferences.set("hall", at(1))
    store.put("maps/hall/georeference/000002.json", b'{"latitude_deg": 1}')
    with pytest.raises(StoreError, match="000002"):
        georeferences.get("hall")
    with pytest.raises(InvalidOption):
        georeferences.get("../x")

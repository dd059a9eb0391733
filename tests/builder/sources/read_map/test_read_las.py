"""LAS: the unit that the file tells (GeoTIFF keys and WKT, as PDAL 2.9 writes them), and flags."""

from __future__ import annotations

import struct
from pathlib import Path

import laspy
import numpy as np
import pytest

from firstfix.errors import InvalidOption, MalformedData, UnsupportedFormat
from firstfix_builder.sources.read_map import read_map
from firstfix_builder.sources.read_map.what_was_read import LeftOut
from tests.every_case import every_case

POINTS = np.random.default_rng(5).uniform([0, 0, 0], [60, 40, 8], (500, 3))
FOOT, SURVEY_FOOT = 0.3048, 1200 / 3937
GEOGCS = 'GEOGCS["NAD83",DATUM["x",SPHEROID["GRS 1980",6378137,298.257]],UNIT["degree",0.0174532925]]'
PROJCS = (
    'PROJCS["Oregon",' + GEOGCS + ',PROJECTION["Lambert"],PARAMETER["false_easting",1312335.958],{},'
    'AXIS["X",EAST]]'
)
VERTICAL = 'VERT_CS["NAVD88",VERT_DATUM["North American",2005],{},AXIS["Up",UP]]'
US_FOOT = 'UNIT["US survey foot",0.304800609601219,AUTHORITY["EPSG","9003"]]'
METRE = 'UNIT["metre",1,AUTHORITY["EPSG","9001"]]'
WKT_2 = (
    'PROJCRS["NAD83 / Ohio (ftUS)",BASEGEOGCRS["NAD83",DATUM["n",ELLIPSOID["GRS",6378137,298,'
    'LENGTHUNIT["metre",1]]]],CONVERSION["SPCS",METHOD["Lambert"],PARAMETER["Easting",1,LENGTHUNIT["metre",1]]],'
    'CS[Cartesian,2],AXIS["easting (X)",east,ORDER[1],LENGTHUNIT["US survey foot",0.304800609601219]],'
    'AXIS["northing (Y)",north,ORDER[2],LENGTHUNIT["US survey foot",0.304800609601219]],ID["EPSG",3735]]'
)


def keys(**by_number: int) -> laspy.VLR:
    """A GeoKeyDirectory of SHORTs."""
    rows = [(int(key[1:]), 0, 1, value) for key, value in by_number.items()]
    return laspy.VLR("LASF_Projection", 34735, "", struct.pack("<4H", 1, 1, 0, len(rows)) + keys_of(rows))


def keys_of(rows: list[tuple[int, int, int, int]]) -> bytes:
    return b"".join(struct.pack("<4H", *row) for row in rows)


def wkt(text: str) -> laspy.VLR:
    return laspy.VLR("LASF_Projection", 2112, "", text.encode() + b"\0")


def of_its_own(metres: float) -> list[laspy.VLR]:
    """A unit of its own: the key points into the record of doubles."""
    rows = [(1024, 0, 1, 1), (3076, 0, 1, 32767), (3077, 34736, 1, 1)]
    directory = laspy.VLR("LASF_Projection", 34735, "", struct.pack("<4H", 1, 1, 0, 3) + keys_of(rows))
    return [directory, laspy.VLR("LASF_Projection", 34736, "", struct.pack("<2d", 5.0, metres))]


def write(
    path: Path, records: list[laspy.VLR], *, point_format: int = 6, behind: bool = False, **flags
) -> Path:
    las = laspy.create(point_format=point_format, file_version="1.4" if point_format >= 6 else "1.2")
    las.header.scales = [0.0001] * 3
    las.x, las.y, las.z = POINTS.T
    for name, values in flags.items():
        las[name] = values
    if behind:
        las.header.evlrs = laspy.vlrs.vlrlist.VLRList()
        las.evlrs.extend(records)
    else:
        las.header.vlrs.extend(records)
    las.write(path)
    return path


UNITS = {
    "nothing": ([], (1, 1), ""),
    "metre": ([keys(k1024=1, k3076=9001, k4099=9001)], (1, 1), "metre"),
    "foot, heights unsaid": ([keys(k1024=1, k3072=32767, k3076=9002)], (FOOT, FOOT), "international foot"),
    "survey foot": ([keys(k3076=9003, k4099=9003)], (SURVEY_FOOT, SURVEY_FOOT), "US survey foot"),
    "metre, heights in feet": ([keys(k3076=9001, k4099=9003)], (1, SURVEY_FOOT), "heights in US survey foot"),
    "a foot of its own": (of_its_own(0.3047997), (0.3047997, 0.3047997), "its own unit"),
    "WKT": ([wkt(PROJCS.format(US_FOOT))], (SURVEY_FOOT, SURVEY_FOOT), "US survey foot"),
    "WKT, metres": ([wkt(PROJCS.format(METRE))], (1, 1), "metre"),
    "WKT, heights apart": (
        [wkt(f'COMPD_CS["both",{PROJCS.format(METRE)},{VERTICAL.format(US_FOOT)}]')],
        (1, SURVEY_FOOT),
        "metre, heights in US survey foot",
    ),
    "WKT 2": ([wkt(WKT_2)], (SURVEY_FOOT, SURVEY_FOOT), "US survey foot"),
    "geographic, but metres": ([keys(k1024=2, k4099=9001)], (1, 1), "degree, heights in metre"),
    "damaged WKT": ([wkt(PROJCS.format(US_FOOT)[:-30])], (1, 1), ""),
    "damaged keys": ([laspy.VLR("LASF_Projection", 34735, "", b"\1\0\1\0\0\0\7\0\4\x0c")], (1, 1), ""),
}


@every_case("records, metres, unit", UNITS.values(), ids=list(UNITS))
def test_the_unit_that_a_file_tells_is_converted(tmp_path, records, metres, unit):
    for number, (point_format, behind) in enumerate([(6, False), (6, True), (1, False)]):
        path = write(tmp_path / f"{number}.las", records, point_format=point_format, behind=behind)
        data = read_map(path)
        np.testing.assert_allclose(data.points, POINTS * [metres[0], metres[0], metres[1]], atol=1e-4)
        assert data.read.unit.endswith(unit)
        assert data.metres == (1, 1)


def test_a_given_scale_goes_before_what_the_file_tells(tmp_path):
    path = write(tmp_path / "a.las", [keys(k3076=9003)])
    np.testing.assert_allclose(read_map(path, scale=0.01).points, POINTS * 0.01, atol=1e-4)


def test_poses_beside_a_map_in_feet_need_a_unit(tmp_path):
    path = write(tmp_path / "a.las", [keys(k3076=9003)])
    poses = tmp_path / "poses.txt"
    poses.write_text("0 10 20 3 0 0 0 1\n")
    with pytest.raises(InvalidOption, match=r"in US survey foot, and the poses .* --scale 0\.3048006096 if"):
        read_map(path, trajectory=poses)
    data = read_map(path, trajectory=poses, scale=0.3048006096)
    np.testing.assert_allclose(data.trajectory[0, :3, 3], [3.048006, 6.096012, 0.914402], atol=1e-6)


@pytest.mark.parametrize("k3076", [9001, 9002])
def test_no_scale_is_advised_where_heights_have_a_unit_of_their_own(tmp_path, k3076):
    path = write(tmp_path / "a.las", [keys(k3076=k3076, k4099=9003)])
    poses = tmp_path / "poses.txt"
    poses.write_text("0 10 20 3 0 0 0 1\n")
    with pytest.raises(InvalidOption, match=r"heights in US survey foot, .*: give both files in metres$"):
        read_map(path, trajectory=poses)


@pytest.mark.parametrize("point_format", [1, 6])
def test_withheld_points_and_noise_are_left_out(tmp_path, point_format):
    withheld, kinds = np.zeros(500, bool), np.full(500, 2)
    withheld[:70], kinds[60:100], kinds[100:105] = True, 7, 18
    path = write(tmp_path / "a.laz", [], point_format=point_format, withheld=withheld, classification=kinds)
    data = read_map(path)
    np.testing.assert_allclose(data.points, POINTS[105:], atol=1e-4)
    assert data.read.left_out == (
        LeftOut("points", "withheld, which stands for deleted", 70),
        LeftOut("points", "classed as noise (7 or 18)", 35),
    )
    path = write(tmp_path / "b.las", [], classification=np.full(500, 7))
    with pytest.raises(MalformedData, match="all its 500 points are withheld, or classed as noise"):
        read_map(path)


def test_degrees_are_named(tmp_path):
    las = laspy.create(point_format=6, file_version="1.4")
    las.header.scales, las.header.offsets = [1e-8, 1e-8, 0.001], [8.5, 47.4, 0]
    las.x, las.y, las.z = (POINTS * [1e-5, 1e-5, 1] + [8.54, 47.37, 400]).T
    las.header.vlrs.append(wkt(GEOGCS))
    las.write(tmp_path / "a.las")
    with pytest.raises(UnsupportedFormat, match=r"degrees \(NAD83\): project them to metres"):
        read_map(tmp_path / "a.las")

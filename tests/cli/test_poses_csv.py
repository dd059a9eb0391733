"""Reading of POSES.csv, and errors for damaged files."""

from __future__ import annotations

import numpy as np
import pytest

from firstfix.errors import MalformedData, NotFound
from firstfix_cli.poses_csv import read_poses_csv

HEADER = "scan,tx,ty,tz,qx,qy,qz,qw\n"


def test_poses_and_places_that_are_not_in_the_map(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text(
        "note, scan, qw, tx, ty, tz, qx, qy, qz\n"
        "x, scans/1.pcd, 0.7071067811865476, 1, 2, 3, 0, 0, 0.7071067811865476\n"
        "y, /elsewhere/2.pcd, , , , , , , \n",
        encoding="utf-8-sig",
    )
    first, second = read_poses_csv(path)
    assert first.path == tmp_path / "scans/1.pcd"
    np.testing.assert_allclose(
        first.T_map_sensor, [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-12
    )
    assert str(second.path) == "/elsewhere/2.pcd"
    assert second.T_map_sensor is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no column scan"),
        ("scan,tx,ty,tz,qx,qy,qz\na,1,2,3,0,0,0\n", "has no column qw"),
        (HEADER, "has no scans"),
        (HEADER + "a,1,2,3,0,0,0,1\nb,1,2,,0,0,0,1\n", "line 3"),
        (HEADER + "a,1,2,3,0,0,0,0\n", "line 2.*quaternion"),
        (HEADER + "a,1,2,nan,0,0,0,1\n", "not finite"),
        (HEADER + "a,1,2,x,0,0,0,1\n", "seven numbers"),
        (HEADER + ",1,2,3,0,0,0,1\n", "no path"),
        (HEADER + "a,1\n", "seven numbers"),
    ],
)
def test_damage_is_named_with_its_line(tmp_path, text, says):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(MalformedData, match=says) as caught:
        read_poses_csv(path)
    assert str(path) in str(caught.value)


def test_no_text_and_no_file(tmp_path):
    (tmp_path / "poses.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MalformedData):
        read_poses_csv(tmp_path / "poses.csv")
    with pytest.raises(NotFound):
        read_poses_csv(tmp_path / "nothere.csv")

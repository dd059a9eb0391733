import numpy as np
import pytest

from firstfix.errors import InvalidScan, TooLarge
from firstfix.scan.scan import MAX_POINTS, Scan
from firstfix.scan.sequence import MAX_SCANS, ScanSequence
from firstfix.transform import make_transform, rotation_z

SCAN = Scan(np.ones((5, 3), np.float32))


def pose(x: float, yaw: float = 0.0) -> np.ndarray:
    return make_transform(rotation_z(yaw), [x, 0, 0])


def test_poses_of_a_sequence_are_in_the_frame_of_the_last_scan():
    anywhere = make_transform(rotation_z(1.1), [300.0, -20.0, 2.0])
    way = [pose(0), pose(1.0, 0.3), pose(2.0, 0.5)]
    here = ScanSequence.along([SCAN] * 3, way)
    there = ScanSequence.along([SCAN] * 3, [anywhere @ T for T in way])
    assert np.allclose(here.T_last_scan[-1], np.eye(4))
    for a, b in zip(here.T_last_scan, there.T_last_scan, strict=True):
        assert np.allclose(a, b, atol=1e-9)
    point = np.array([1.0, 2.0, 3.0, 1.0])
    assert np.allclose(way[2] @ here.T_last_scan[0] @ point, way[0] @ point)


@pytest.mark.parametrize(
    ("scans", "poses"),
    [
        ([], []),
        ([SCAN], []),
        ([SCAN, SCAN], [np.eye(4), np.eye(3)]),
        ([SCAN, SCAN], [np.eye(4), np.eye(4) * 2]),
        ([SCAN, SCAN], [np.eye(4), np.full((4, 4), np.nan)]),
        ([SCAN, SCAN], [np.eye(4), np.diag([1.0, 1, -1, 1])]),
        ([SCAN, SCAN], [pose(0), pose(1001.0)]),
        ([SCAN] * 2, [np.eye(4), make_transform(np.eye(3), [0, 0, 1e231])]),
        ([SCAN] * 2, [make_transform(rotation_z(1), [1e308, 1e308, 0])] * 2),
    ],
)
def test_an_invalid_sequence_is_refused(scans, poses):
    with pytest.raises(InvalidScan):
        ScanSequence.along(scans, poses)


def test_scans_and_points_of_a_sequence_are_limited():
    with pytest.raises(TooLarge, match="scans"):
        ScanSequence.along([SCAN] * (MAX_SCANS + 1), [np.eye(4)] * (MAX_SCANS + 1))
    half = Scan(np.broadcast_to(np.ones(3, np.float32), (MAX_POINTS // 2 + 1, 3)))
    with pytest.raises(TooLarge, match="points"):
        ScanSequence.along([half, half], [np.eye(4)] * 2)

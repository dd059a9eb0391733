"""Several scans together are as good as the best of them, and resolve ambiguous ones."""

import numpy as np
import pytest

from firstfix.answer.localization import Verdict
from firstfix.decode import decode_query
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import inverse, make_transform, pose_error, rotation_z
from firstfix.wire.sequence import MEDIA_TYPE, encode_scans


@pytest.fixture(scope="module")
def localizer(small_version):
    return Localizer(MapIndex.load(small_version.directory))


def way_of(scans):
    """Returns the true poses in the frame of an odometry."""
    start = make_transform(rotation_z(0.7), [40.0, -3.0, 1.0])
    return [start @ inverse(scans[0][1]) @ T for _, T in scans]


def test_three_scans_give_the_pose_of_the_last(localizer, small_scans):
    for first in range(0, 12, 3):
        part = small_scans[first : first + 3]
        answer = localizer.localize(ScanSequence.along([s for s, _ in part], way_of(part)))
        off_m, off_deg = pose_error(part[-1][1], answer.hypotheses[0].T_map_sensor)
        assert off_m < 0.1
        assert off_deg < 1


def test_more_scans_localize_more_often(localizer, small_scans):
    alone = sum(localizer.localize(s).verdict is Verdict.LOCALIZED for s, _ in small_scans[:12])
    together = sum(
        localizer.localize(
            ScanSequence.along([s for s, _ in small_scans[n : n + 3]], way_of(small_scans[n : n + 3]))
        ).verdict
        is Verdict.LOCALIZED
        for n in range(12)
    )
    assert together >= alone


def test_a_scan_that_sees_nothing_does_not_spoil_the_others(localizer, small_scans):
    (seen, T_map_sensor), nothing = small_scans[0], Scan(np.zeros((0, 3), np.float32))
    answer = localizer.localize(ScanSequence.along([seen, nothing], [np.eye(4), np.eye(4)]))
    assert pose_error(T_map_sensor, answer.hypotheses[0].T_map_sensor)[0] < 0.1


def test_the_encoding_carries_them(localizer, small_scans):
    part = small_scans[3:5]
    for form in ("points", "range_image"):
        body = encode_scans([s for s, _ in part], way_of(part), form=form)
        answer = localizer.localize(decode_query(body, MEDIA_TYPE))
        assert pose_error(part[-1][1], answer.hypotheses[0].T_map_sensor)[0] < 0.1

"""What the clients put on the wire for one scan and for several."""

import numpy as np

from firstfix import wire, wire_sequence
from firstfix.decode import decode_query
from firstfix.scan import Scan
from firstfix.scan_sequence import ScanSequence
from firstfix.transform import make_transform, rotation_z
from firstfix_client.scan_body import encoded

POINTS = np.random.default_rng(0).uniform(-9, 9, (40, 3)).astype(np.float32)
SCAN = Scan(POINTS, np.arange(40, dtype=np.float32))


def test_one_scan_goes_without_its_intensity():
    media_type, body = encoded(SCAN, resolution_m=0.01, voxel_m=None)
    assert media_type == wire.MEDIA_TYPE
    scan = decode_query(body, media_type)
    assert scan.intensity is None
    assert np.abs(scan.points - POINTS).max() <= 0.00501


def test_several_go_with_the_way_between_them():
    way = [make_transform(rotation_z(0.1 * n), [n, 0, 0]) for n in range(3)]
    sequence = ScanSequence.along([SCAN] * 3, way)
    media_type, body = encoded(sequence, resolution_m=0.01, voxel_m=None)
    assert media_type == wire_sequence.MEDIA_TYPE
    received = decode_query(body, media_type)
    assert [scan.intensity for scan in received.scans] == [None] * 3
    assert np.allclose(received.T_last_scan, sequence.T_last_scan)

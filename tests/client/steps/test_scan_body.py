"""Bytes that the clients send for one scan and for several."""

import numpy as np
import pytest

from firstfix.decode import decode_query
from firstfix.descriptor import LayeredOccupancy, PolarGrid
from firstfix.errors import InvalidOption
from firstfix.scan.compact import CompactScan, ScanDescriptor
from firstfix.scan.condense import condense
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import make_transform, rotation_z
from firstfix.wire import query as wire_query
from firstfix.wire import scan as wire
from firstfix.wire import sequence as wire_sequence
from firstfix_client.steps.scan_body import MAX_COMPACT_BYTES, BodyForm, encoded
from tests.every_case import every_case

POINTS = np.random.default_rng(0).uniform(-9, 9, (40, 3)).astype(np.float32)
PARAMETERS = DescriptorParameters(descriptor=LayeredOccupancy(PolarGrid(20, 60, 25.0)))
SCAN = Scan(POINTS, np.arange(40, dtype=np.float32))


def test_one_scan_goes_without_its_intensity():
    media_type, body = encoded(SCAN, BodyForm())
    assert media_type == wire.MEDIA_TYPE
    scan = decode_query(body, media_type)
    assert scan.intensity is None
    assert np.abs(scan.points - POINTS).max() <= 0.00501


def test_a_range_image_has_the_clients_resolution_and_voxels():
    media_type, body = encoded(SCAN, BodyForm("range_image"))
    assert (media_type, body[5]) == (wire.MEDIA_TYPE, wire.KIND_RANGE_IMAGE)
    assert body == wire.encode_scan(SCAN, form="range_image", resolution_m=0.025)
    _, coarse = encoded(SCAN, BodyForm("range_image", resolution_m=0.5, voxel_m=9.0))
    assert coarse == wire.encode_scan(SCAN, form="range_image", resolution_m=0.5, voxel_m=9.0)
    assert len(decode_query(coarse, media_type)) < len(decode_query(body, media_type))


def test_several_scans_go_as_range_images():
    sequence = ScanSequence.along([SCAN, condense(SCAN)], [np.eye(4)] * 2)
    media_type, body = encoded(sequence, BodyForm("range_image"))
    assert media_type == wire_sequence.MEDIA_TYPE
    first, second = decode_query(body, media_type).scans
    assert np.array_equal(first.points, wire.decode_scan(encoded(SCAN, BodyForm("range_image"))[1]).points)
    assert isinstance(second, CompactScan)


def test_several_scans_go_with_the_way_between_them():
    way = [make_transform(rotation_z(0.1 * n), [n, 0, 0]) for n in range(3)]
    sequence = ScanSequence.along([SCAN] * 3, way)
    media_type, body = encoded(sequence, BodyForm())
    assert media_type == wire_sequence.MEDIA_TYPE
    received = decode_query(body, media_type)
    assert [scan.intensity for scan in received.scans] == [None] * 3
    assert np.allclose(received.T_last_scan, sequence.T_last_scan)


@every_case("is_timed", [False, True])
def test_a_compact_query_stays_under_its_limit(is_timed: bool):
    """Returns a scan with random ranges, which hardly compresses."""
    rng = np.random.default_rng(2)
    azimuth, elevation = rng.uniform(-np.pi, np.pi, 100_000), rng.uniform(-0.35, 0.35, 100_000)
    across = rng.uniform(1, 50, 100_000) * np.cos(elevation)
    band = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), across * np.tan(elevation)], axis=1)
    scan = Scan.from_points(band, time_s=rng.uniform(0, 0.1, 100_000) if is_timed else None)
    as_it_is = condense(scan)
    assert len(wire_query.encode_query(as_it_is)) > MAX_COMPACT_BYTES
    media_type, body = encoded(scan, BodyForm("compact"))
    assert media_type == wire_query.MEDIA_TYPE
    query = decode_query(body, media_type)
    assert isinstance(query, CompactScan)
    assert len(body) < MAX_COMPACT_BYTES
    assert 500 < len(query) < len(as_it_is)
    assert (query.time_s is not None) == is_timed


def test_gravity_levels_the_descriptor():
    down = np.array([0.0, 0.6, -0.8])
    media_type, body = encoded(SCAN, BodyForm("descriptor", PARAMETERS), down)
    descriptor = decode_query(body, media_type)
    assert isinstance(descriptor, ScanDescriptor)
    assert np.allclose(descriptor.up, -down)


def test_gravity_levels_each_of_several_compact_scans():
    """Gravity is that of the last scan, and the robot has rolled since the first."""
    down, rolled = np.array([0.0, 0.6, -0.8]), make_transform(np.diag([1.0, -1, -1]), [1.0, 0, 0])
    sequence = ScanSequence.along([SCAN] * 2, [np.eye(4), rolled])
    media_type, body = encoded(sequence, BodyForm("compact", PARAMETERS), down)
    assert media_type == wire_sequence.MEDIA_TYPE
    scans = decode_query(body, media_type).scans
    assert [type(scan) for scan in scans] == [CompactScan] * 2
    first, last = (scan.described for scan in scans)
    assert np.allclose(first.up, [0, 0.6, -0.8])
    assert np.allclose(last.up, -down)


def test_invalid_forms_are_refused():
    sequence = ScanSequence.along([SCAN] * 2, [np.eye(4)] * 2)
    for scan, form in (
        (SCAN, BodyForm("descriptor")),
        (sequence, BodyForm("descriptor", PARAMETERS)),
        (SCAN, BodyForm("smoke")),
    ):
        with pytest.raises(InvalidOption):
            encoded(scan, form)

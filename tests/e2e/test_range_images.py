"""Range images on a real version get the same answers as scans."""

from __future__ import annotations

from firstfix.decode import decode_query
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import pose_error
from firstfix.wire.scan import MEDIA_TYPE, encode_scan


def test_a_range_image_is_answered_like_its_scan(small_version, small_scans):
    localizer = Localizer(MapIndex.load(small_version.directory))
    right = {"scan": 0, "range image": 0}
    for scan, T_map_sensor in small_scans:
        body = encode_scan(scan, form="range_image")
        assert len(body) < len(encode_scan(scan)) / 2
        whole, image = localizer.localize(scan), localizer.localize(decode_query(body, MEDIA_TYPE))
        for name, answer in (("scan", whole), ("range image", image)):
            right[name] += (
                answer.T_map_sensor is not None and pose_error(T_map_sensor, answer.T_map_sensor)[0] < 0.2
            )
        if whole.T_map_sensor is not None and image.T_map_sensor is not None:
            metres, degrees = pose_error(whole.T_map_sensor, image.T_map_sensor)
            assert metres < 0.05
            assert degrees < 0.5
    assert right["scan"] >= 15
    assert right["range image"] >= right["scan"] - 1

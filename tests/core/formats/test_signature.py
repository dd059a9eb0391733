"""Bodies without a media type that says what they are: their own first bytes decide."""

from __future__ import annotations

import gzip
import pickle

import numpy as np
import pytest

from firstfix.decode import GENERAL_TYPES, decode_query, decoder_of
from firstfix.errors import MalformedData, UnsupportedFormat
from firstfix.formats.signature import media_type_of
from firstfix.scan.sequence import ScanSequence
from firstfix.scan_formats import LAS, SCAN_FORMATS
from firstfix.wire.content_encoding import undo_content_encoding
from tests.core.formats.cloud_files import pcd, ply, random_cloud
from tests.every_case import every_case
from tests.hostile_bodies import good_bodies, npy

CLOUD = random_cloud(300)
XYZ = np.stack([CLOUD[axis] for axis in "xyz"], axis=1)
RAW = ("application/vnd.firstfix.xyz", "application/vnd.firstfix.xyzi")


def plain_bodies():
    for body in good_bodies():
        yield (
            body.name,
            body.media_type,
            undo_content_encoding(body.data, body.content_encoding or "", 1 << 20),
        )


def test_every_format_but_raw_rows_is_told_by_its_first_bytes():
    told = set()
    for name, media_type, data in plain_bodies():
        if media_type in RAW:
            with pytest.raises(UnsupportedFormat, match=r"application/vnd\.firstfix\.xyz"):
                decode_query(data, "application/octet-stream")
            continue
        (found,) = (each for each in SCAN_FORMATS if media_type_of(data) in each.media_types)
        assert media_type in found.media_types, name
        told.add(found.media_types[0])
    assert told == {each.media_types[0] for each in SCAN_FORMATS} - {*RAW, *LAS}


def test_a_general_type_gives_the_same_scan_as_the_true_one():
    for name, media_type, data in plain_bodies():
        if media_type in RAW:
            continue
        expected = decode_query(data, media_type)
        for general in (*GENERAL_TYPES, "Application/Octet-Stream; charset=binary"):
            found = decode_query(data, general)
            assert type(found) is type(expected), name
            if not isinstance(found, ScanSequence):
                np.testing.assert_array_equal(found.points, expected.points)


def test_a_decoder_crosses_to_a_worker_and_knows_a_message_with_a_stamp():
    for media_type in ("", "application/x-pcd"):
        decoder = pickle.loads(pickle.dumps(decoder_of(media_type)))
        assert not decoder.is_point_cloud2(pcd(CLOUD, "binary"))
    (message, *_) = (data for name, _, data in plain_bodies() if "cdr" in name)
    assert decoder_of("").is_point_cloud2(message)


@every_case(
    ("data", "error", "said"),
    [
        (b"", MalformedData, r"empty \(0 bytes\)"),
        (gzip.compress(XYZ.tobytes()), UnsupportedFormat, "Content-Encoding: gzip"),
        (b"\x28\xb5\x2f\xfd" + bytes(50), UnsupportedFormat, "Content-Encoding: zstd"),
        (b"\x89PNG\r\n" + bytes(50), UnsupportedFormat, "a PNG image"),
        (b"ASTM-E57" + bytes(50), UnsupportedFormat, "an E57 file"),
        (b"\x89MCAP0\r\n" + bytes(50), UnsupportedFormat, "localize --bag"),
        (XYZ.tobytes(), UnsupportedFormat, "Rows of float32 without a header"),
        (b'{"map": "hall"}', MalformedData, "no field x"),
        (b"map=hall&scan=1", MalformedData, "no field x"),
    ],
)
def test_a_body_that_is_no_scan_is_named(data, error, said):
    with pytest.raises(error, match=said):
        decode_query(data, "application/x-www-form-urlencoded")


def stripped(data: bytes) -> bytes:
    """Data as curl's -d sends it."""
    return data.translate(None, b"\r\n\0")


@every_case(
    ("data", "media_type"),
    [
        (pcd(CLOUD, "ascii"), "application/x-pcd"),
        (pcd(CLOUD, "binary"), ""),
        (pcd(CLOUD[:2], "ascii"), ""),
        (ply(CLOUD, "binary_little_endian"), "application/ply"),
        (ply(CLOUD[:2], "ascii"), "application/x-www-form-urlencoded"),
        (npy(XYZ), "application/x-npy"),
        (b"".join(b"%.3f,%.3f,%.3f\n" % tuple(point) for point in XYZ.tolist()), "text/csv"),
    ],
)
def test_what_curl_took_out_is_named(data, media_type):
    decode_query(data, media_type)  # it is a scan
    with pytest.raises(MalformedData, match="--data-binary"):
        decode_query(stripped(data), media_type)


def test_other_faults_do_not_speak_of_curl():
    for data, media_type in ((pcd(CLOUD, "binary")[:-100], ""), (b"# .PCD v0.7\nVERSION 0.7\n", "")):
        with pytest.raises(MalformedData) as caught:
            decode_query(data, media_type)
        assert "--data-binary" not in str(caught.value)

"""LAS and LAZ bodies: read by a confined process of the builder, never by the one that asks."""

from __future__ import annotations

import io
import subprocess
import sys
from pathlib import Path

import laspy
import numpy as np
import pytest

from firstfix.decode import decode_query, decoder_of
from firstfix.errors import MalformedData, TooLarge, UnsupportedFormat
from firstfix.formats import confined_las
from firstfix.formats.confined_las import decode_las_confined
from firstfix.formats.point_cloud import SCAN_LIMITS, Limits
from firstfix.formats.signature import media_type_of
from firstfix.scan_formats import LAS
from firstfix_builder.sandbox import read_las

POINTS = np.random.default_rng(4).uniform(-20, 20, (400, 3))


def las_body(*, compress: bool) -> bytes:
    las = laspy.create(point_format=6, file_version="1.4")
    las.header.scales = [0.0001] * 3
    las.x, las.y, las.z = POINTS.T
    las.intensity = np.arange(400, dtype=np.uint16)
    las.gps_time = np.linspace(0, 0.1, 400)
    file = io.BytesIO()
    las.write(file, do_compress=compress)
    return file.getvalue()


@pytest.mark.parametrize("compress", [False, True])
def test_a_body_is_read_with_intensity_and_times(compress: bool):
    body = las_body(compress=compress)
    assert media_type_of(body) in LAS
    scan = decode_query(body, "application/octet-stream")
    np.testing.assert_allclose(scan.points, POINTS, atol=1e-4)
    np.testing.assert_array_equal(scan.intensity, np.arange(400))
    assert scan.time_s is not None


def test_the_process_that_asks_loads_no_reader():
    program = (
        "import sys; from firstfix.decode import decode_query\n"
        "print(len(decode_query(sys.stdin.buffer.read(), '').points), {'laspy', 'lazrs'} & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], input=las_body(compress=True), capture_output=True, check=True
    )
    assert done.stdout.split() == [b"400", b"set()"]


def test_damaged_files_are_malformed():
    body = las_body(compress=True)
    for damaged in (body[: len(body) // 2], b"LASF" + bytes(400)):
        with pytest.raises(MalformedData, match="LAS: "):
            decode_query(damaged, LAS[0])
    with pytest.raises(TooLarge, match="the limit is"):
        decode_las_confined(las_body(compress=False), Limits(10, 100))


@pytest.mark.parametrize(
    "program",
    [
        "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
        "import sys, os; os.write(int(sys.argv[2]), b'{}'); sys.exit(3)",
        "import sys, os; os.write(int(sys.argv[2]), b'no array'); sys.exit(0)",
        "pass",
    ],
)
def test_a_reader_that_crashes_or_lies_costs_its_query_alone(program: str, monkeypatch, tmp_path):
    (tmp_path / "bad_reader.py").write_text(program)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(confined_las, "PROGRAM", "bad_reader")
    before = len(list(Path("/proc/self/fd").iterdir()))
    with pytest.raises(MalformedData):
        decode_query(las_body(compress=False), LAS[1])
    assert len(list(Path("/proc/self/fd").iterdir())) <= before


def test_a_reader_sees_no_secret(monkeypatch, tmp_path):
    (tmp_path / "curious.py").write_text(
        "import json, os, sys\n"
        "told = {'code': 'malformed_data', 'message': ' '.join(sorted(os.environ))}\n"
        "os.write(int(sys.argv[2]), json.dumps(told).encode()); sys.exit(3)"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "x")
    monkeypatch.setattr(confined_las, "PROGRAM", "curious")
    with pytest.raises(MalformedData, match="PATH") as caught:
        decode_query(las_body(compress=False), LAS[0])
    assert "AWS" not in str(caught.value)


def test_without_the_builder_the_error_names_what_converts(monkeypatch):
    monkeypatch.setattr(confined_las, "find_spec", lambda name: None)
    body = las_body(compress=True)
    with pytest.raises(UnsupportedFormat, match=r"firstfix localize SCAN\.laz"):
        decoder_of("application/vnd.laszip")  # before the body comes
    with pytest.raises(UnsupportedFormat, match=r"firstfix localize SCAN\.laz"):
        decode_query(body, "application/octet-stream")


def test_the_process_may_write_what_a_scan_may_hold():
    assert SCAN_LIMITS.max_decoded_bytes <= read_las.MAX_MADE_BYTES <= 2 * SCAN_LIMITS.max_decoded_bytes

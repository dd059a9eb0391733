"""The service says of a scan what ``firstfix check`` says of its file."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np

from firstfix.scan.scan import Scan
from firstfix.wire.scan import MEDIA_TYPE, encode_scan
from tests.commands import firstfix
from tests.service.service_world import XYZ, Service

POINTS = np.random.default_rng(2).uniform(-8, 8, (3000, 3)).astype("<f4")


def pcd() -> bytes:
    """A binary PCD with intensity, ring and the times of its points in nanoseconds."""
    rows = np.zeros(len(POINTS), [("xyz", "<f4", 3), ("intensity", "<f4"), ("ring", "<u2"), ("t", "<u4")])
    rows["xyz"], rows["ring"] = POINTS, np.arange(len(POINTS)) % 16
    rows["t"] = np.linspace(0, 99_000_000, len(POINTS)).astype(np.uint32)
    head = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z intensity ring t\nSIZE 4 4 4 4 2 4\nTYPE F F F F U U\n"
        f"COUNT 1 1 1 1 1 1\nWIDTH {len(rows)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\n"
        f"POINTS {len(rows)}\nDATA binary\n"
    )
    return head.encode() + rows.tobytes()


def test_fields_and_times_are_told_as_the_command_does(service: Service, tmp_path: Path):
    answer = service.http.post("/scan-report", content=pcd(), headers={"Content-Type": "application/x-pcd"})
    assert answer.status_code == 200, answer.text
    told = answer.json()
    understood = told["understood"]
    assert understood.pop("format") == "application/x-pcd"
    assert "ring uint16" in understood["fields"]
    assert "t uint32 as time" in understood["fields"]
    assert "0 to 99000000 ns" in understood["times"]
    file = tmp_path / "scan.pcd"
    file.write_bytes(pcd())
    (said,) = json.loads(firstfix("check", "--scans", file, "--json").out.splitlines()[-1])[
        "files"
    ]  # after the log
    assert (told["facts"], understood) == (said["facts"], said["understood"])
    assert [one["code"] for one in told["findings"]] == [one["code"] for one in said["findings"]]


def test_points_without_names_and_scans_as_robots_send_them(service: Service):
    raw = service.http.post("/scan-report", content=POINTS.tobytes(), headers={"Content-Type": XYZ})
    assert raw.json()["facts"].startswith("3,000 points")
    scan = Scan.from_points(POINTS, intensity=np.ones(len(POINTS), np.float32))
    sent = service.http.post("/scan-report", content=encode_scan(scan), headers={"Content-Type": MEDIA_TYPE})
    assert "intensity" in sent.json()["understood"]["fields"]


def test_a_body_of_no_type_is_told_by_its_first_bytes(service: Service):
    rows = "i,x,y,z\n" + "\n".join(f"7,{x:.3f},{y:.3f},{z:.3f}" for x, y, z in POINTS)
    array = io.BytesIO()
    np.save(array, POINTS)
    for body, form, fields in (
        (pcd(), "application/x-pcd", "ring uint16"),
        (rows.encode(), "text/plain", "i float64 as intensity"),
        (array.getvalue(), "application/x-npy", "x float32"),
    ):
        for media_type in ("", "application/octet-stream"):
            sent = service.http.post("/scan-report", content=body, headers={"Content-Type": media_type})
            assert sent.status_code == 200, sent.text
            assert sent.json()["facts"].startswith("3,000 points")
            understood = sent.json()["understood"]
            assert understood["format"] == form
            assert fields in understood["fields"]


def test_a_scan_in_millimetres_is_found_before_a_map_is_asked(service: Service):
    body = (POINTS * 1000).tobytes()
    told = service.http.post("/scan-report", content=body, headers={"Content-Type": XYZ}).json()
    assert told["findings"], told
    assert told["findings"][0]["remedy"]


def test_what_is_no_scan_is_refused(service: Service):
    for media_type, body, status in (("text/html", b"x", 415), (XYZ, bytes(7), 400), (XYZ, b"", 400)):
        answer = service.http.post("/scan-report", content=body, headers={"Content-Type": media_type})
        assert answer.status_code == status, answer.text

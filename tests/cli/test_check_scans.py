"""``firstfix check --scans``: what was understood of scans alone."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from firstfix.sensor import preset
from firstfix_cli.main import run
from tests import ros_samples
from tests.core.formats.cloud_files import pcd
from tests.driver_clouds import LAYOUTS
from tests.lidar_messages import ouster_packet
from tests.mcap_files import write_mcap
from tests.measured_room import room_scan

POINTS = room_scan(preset("vlp-16"), 1)[0]
SWEEP_S = np.linspace(0, 0.0999, len(POINTS))


def checked(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[dict[str, object]]]:
    with pytest.raises(SystemExit) as ended:
        run(["check", "--scans", "--json", *arguments])
    return int(ended.value.code or 0), json.loads(capsys.readouterr().out)["files"]


def write(path: Path, name: str, times: np.ndarray) -> str:
    records = np.zeros(
        len(POINTS), [*((axis, "<f4") for axis in "xyz"), (name, times.dtype.str), ("ring", "<u2")]
    )
    for k, axis in enumerate("xyz"):
        records[axis] = POINTS[:, k]
    records[name], records["ring"] = times, np.arange(len(POINTS)) % 16
    records["x"][:5] = np.nan
    path.write_bytes(pcd(records, "binary"))
    return str(path)


def test_a_scan_alone_says_what_was_understood(tmp_path: Path, capsys):
    path = write(tmp_path / "a.pcd", "t", (SWEEP_S * 1e9).astype(np.uint32))
    code, (said,) = checked(capsys, path)
    assert (code, said["file"], said["findings"]) == (0, path, [])
    understood = said["understood"]
    assert understood["fields"] == "x float32, y float32, z float32, t uint32 as time, ring uint16; metres"
    assert understood["times"].startswith("t (uint32, ")
    assert understood["times"].endswith(
        " ns), counted from the scan's stamp: 0.0000 to 0.0999 s from the stamp"
    )
    assert understood["rings"] == "16, by the field"
    assert "0.60 m above the floor" in understood["mounting"]
    assert "5 points not finite" in understood["left_out"]


def test_times_that_were_not_understood_are_a_finding(tmp_path: Path, capsys):
    paths = [
        write(tmp_path / "a.pcd", "ts", SWEEP_S * 50),
        write(tmp_path / "b.pcd", "time", np.zeros(len(POINTS))),
    ]
    code, said = checked(capsys, *paths)
    assert code == 0
    assert [[one["code"] for one in each["findings"]] for each in said] == [["time_field_unknown"], []]
    assert "ts (float64, " in said[0]["findings"][0]["text"]
    assert [each["understood"]["times"].split(":")[0] for each in said] == ["none", "none"]


def test_the_columns_of_rows_can_be_told(tmp_path: Path, capsys):
    rows = np.column_stack([SWEEP_S, POINTS]).astype("<f4")
    rows.tofile(tmp_path / "a.bin")
    code, (said,) = checked(capsys, str(tmp_path / "a.bin"), "--columns", "time,x,y,z")
    assert code == 0
    assert said["understood"]["times"].endswith("0.0000 to 0.0999 s from the stamp")
    with pytest.raises(SystemExit):
        run(["sensor", str(tmp_path / "a.bin"), "--columns", "time,x,y,z"])
    assert "# times: time (float32, " in capsys.readouterr().out


def test_a_recording_alone_says_what_its_topics_have(tmp_path: Path, capsys):
    messages = []
    for topic, driver in (("/front", "ouster"), ("/rear", "velodyne")):
        raw = LAYOUTS[driver].message(POINTS.astype(np.float64), SWEEP_S)
        messages.append((topic, 1, ros_samples.ROS2.deserialize_cdr(raw, ros_samples.CLOUD)))
    path = ros_samples.write_bag(tmp_path, "mcap file", messages)
    code, said = checked(capsys, str(path))
    assert code == 0
    assert [one["file"] for one in said] == [f"{path} /front", f"{path} /rear"]
    assert [one["understood"]["frame"] for one in said] == ["lidar", "lidar"]
    assert [one["understood"]["times"].split(" (")[0] for one in said] == ["t", "time"]


def test_a_topic_that_cannot_be_read_is_named_beside_one_that_can(tmp_path: Path, capsys):
    """Packets whose metadata was not recorded, beside the clouds of another LiDAR."""
    raw = LAYOUTS["ouster"].message(POINTS.astype(np.float64), SWEEP_S)
    messages = [
        ("/front", 1, ros_samples.ROS2.deserialize_cdr(raw, ros_samples.CLOUD)),
        ("/os/lidar_packets", 2, ouster_packet(bytes(100))),
    ]
    path = ros_samples.write_bag(tmp_path, "mcap file", messages)
    code, (front, packets) = checked(capsys, str(path))
    assert (code, front["file"], packets["file"]) == (0, f"{path} /front", f"{path} /os/lidar_packets")
    assert front["understood"]["frame"] == "lidar"
    assert "needs the sensor's metadata" in packets["facts"]
    assert "recording" not in front["understood"]


def test_a_cut_recording_says_so(tmp_path: Path, capsys):
    raw = LAYOUTS["ouster"].message(POINTS.astype(np.float64), SWEEP_S)
    clouds = [("/front", ros_samples.CLOUD, "cdr", b"", n + 1, raw) for n in range(4)]
    path = write_mcap(tmp_path / "a.mcap", clouds, chunk_size=1000)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    _, (said,) = checked(capsys, str(path))
    assert "was cut off while it was recorded" in said["understood"]["recording"]


def test_a_file_that_cannot_be_read_is_told_of_and_the_next_ones_are_read(tmp_path: Path, capsys):
    good = write(tmp_path / "a.pcd", "t", (SWEEP_S * 1e9).astype(np.uint32))
    (tmp_path / "cut.pcd").write_bytes(Path(good).read_bytes()[:2000])
    (tmp_path / "a.doc").write_bytes(b"text")
    (tmp_path / "cut.mcap").write_bytes(b"not an mcap")
    bad = [str(tmp_path / name) for name in ("cut.pcd", "a.doc", "cut.mcap", "none.pcd")]
    code, said = checked(capsys, bad[0], good, *bad[1:], good)
    assert code == 2
    assert [one["file"] for one in said] == [bad[0], good, *bad[1:], good]
    assert ["error" in one for one in said] == [True, False, True, True, True, False]
    codes = [one["error"]["code"] for one in said if "error" in one]
    assert codes == ["malformed_data", "unsupported_format", "malformed_data", "no_such_file"]
    with pytest.raises(SystemExit) as ended:
        run(["check", "--scans", bad[0], good])
    assert ended.value.code == 2
    out = capsys.readouterr().out
    assert f"{bad[0]}: not read: PCD: " in out
    assert "Write the scan again" in out
    assert "CloudCompare" not in out
    assert f"{good}: " in out

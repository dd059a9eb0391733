"""``firstfix sensor``: real files in, a YAML out that a build takes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from firstfix.builds.config import BuildConfig
from firstfix.sensor import SensorModel, preset
from firstfix_cli.main import run
from tests.measured_room import room_scan
from tests.needs import RECORDED as DATA
from tests.needs import recorded


def said(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        run(["sensor", *arguments])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


def write_pcd(path: Path, points: np.ndarray, ring: np.ndarray | None = None) -> Path:
    """A binary PCD, with NaN where the sensor saw nothing, as drivers write it."""
    fields = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")] + ([] if ring is None else [("ring", "<u2")])
    rows = np.full(len(points) + 10, 0, fields)
    for column, axis in enumerate("xyz"):
        rows[axis][:-10], rows[axis][-10:] = points[:, column], np.nan
    if ring is not None:
        rows["ring"][:-10] = ring
    kinds = ["F"] * 3 + ([] if ring is None else ["U"])
    sizes = ["4"] * 3 + ([] if ring is None else ["2"])
    head = (
        f"VERSION .7\nFIELDS {' '.join(name for name, _ in fields)}\nSIZE {' '.join(sizes)}\n"
        f"TYPE {' '.join(kinds)}\nCOUNT {' '.join('1' for _ in fields)}\nWIDTH {len(rows)}\nHEIGHT 1\n"
        f"POINTS {len(rows)}\nDATA binary\n"
    )
    path.write_bytes(head.encode() + rows.tobytes())
    return path


@pytest.fixture
def scans(tmp_path: Path) -> list[str]:
    sensor = preset("os1-64")
    made = [room_scan(sensor, seed) for seed in (1, 2)]
    first = write_pcd(tmp_path / "a.pcd", made[0][0], made[0][1] // 1024)
    np.save(tmp_path / "b.npy", made[1][0])
    return [str(first), str(tmp_path / "b.npy")]


def test_the_yaml_on_standard_output_is_a_sensor_of_a_build(scans: list[str], capsys):
    code, out, _ = said(capsys, *scans)
    assert code == 0
    model = BuildConfig.parse({"sensor": yaml.safe_load(out)}).sensor_model
    np.testing.assert_allclose(model.elevations_deg, np.sort(preset("os1-64").elevations_deg), atol=0.02)
    assert model.mount_height_m == pytest.approx(1.0, abs=0.05)
    assert "# looks like os1-64: use --sensor os1-64\n" in out
    assert "64 rings, told by the field of the format" in out


def test_a_sixteen_beam_velodyne_looks_like_itself_first(tmp_path: Path, capsys):
    points, rings = room_scan(preset("vlp-16"), 1)[:2]
    path = write_pcd(tmp_path / "a.pcd", points, rings // round(360 / preset("vlp-16").azimuth_step_deg))
    _, out, _ = said(capsys, str(path))
    assert "# looks like vlp-16 (or rs-helios-16p, xt16, which cannot be told from it): use" in out


def test_a_file_is_written_and_replaced_only_by_force(scans: list[str], tmp_path: Path, capsys):
    written = tmp_path / "new" / "front.yaml"
    code, out, _ = said(capsys, *scans, "--name", "front", "-o", str(written))
    assert code == 0
    assert out.splitlines()[-1] == f"written to {written}"
    assert SensorModel.from_mapping(yaml.safe_load(written.read_text())).name == "front"
    written.write_text("mine")
    code, _, err = said(capsys, *scans, "-o", str(written))
    assert (code, written.read_text()) == (2, "mine")
    assert "--force replaces it" in err
    assert said(capsys, *scans, "-o", str(written), "--force")[0] == 0
    assert written.read_text() != "mine"


def test_json_says_the_same_for_programs(scans: list[str], capsys):
    code, out, _ = said(capsys, *scans, "--json")
    found = json.loads(out)
    assert (code, found["presets"], found["rings_by"], found["scans"]) == (0, ["os1-64"], "field", 2)
    assert SensorModel.from_mapping(found["sensor"]).pattern == "rows"
    assert any("64 rings" in note for note in found["notes"])


def test_what_cannot_be_measured_is_an_error_that_names_the_file(tmp_path: Path, capsys):
    few = write_pcd(tmp_path / "few.pcd", room_scan(preset("vlp-16"), 1)[0][:100])
    other = write_pcd(tmp_path / "other.pcd", room_scan(preset("vlp-16"), 1)[0])
    many = write_pcd(tmp_path / "many.pcd", room_scan(preset("os0-64"), 1)[0])
    (tmp_path / "empty.pcd").write_bytes(b"")
    for names, text in (
        ([few], "100 points are too few"),
        ([other, many], f"{other} has 16 rings, {many} has 64"),
        ([tmp_path / "empty.pcd"], "the file is empty"),
        ([tmp_path / "none.pcd"], "no such file"),
    ):
        code, out, err = said(capsys, *map(str, names))
        assert (code, out) == (2, "")
        assert text in err


# set, files, rings found by, rings, elevation of the lowest and the highest, presets (the first ones)
SETS = {
    "hilti": ("hilti_hall_indoor/queries/scan_0[0-4]*.pcd", "elevation", 50, -24.4, 45.4, {"os0-64"}),
    "kitti": ("formats/original/kitti00_000094.bin", "order", 64, -23.5, 2.6, {"hdl-64e"}),
    "yard": ("yard_vlp16_thin/queries/*.pcd", "elevation", 16, -15, 15, {"vlp-16", "xt16"}),
    "street": ("street_128beam/queries/*", "elevation", 128, -25, 15, {"vls-128"}),
    "velodyne": ("formats/original/velodyne_ring*.pcd", "field", 32, -30.67, 10.67, {"hdl-32e"}),
    "road": ("strangers/road_vlp16_0000*.pcd", "elevation", 16, -15, 15, {"vlp-16", "xt16"}),
    "avia": ("formats/original/helipr_avia_000000.bin", None, None, -31.9, 10.8, {"avia"}),
    "garage": ("garage_sphere_scans/queries/*", None, None, -64, 65.3, set()),
}


@pytest.mark.parametrize("name", SETS)
def test_recorded_scans(name: str, capsys):
    pattern, way, rings, low_deg, high_deg, known = SETS[name]
    recorded(pattern.split("/")[0])
    paths = sorted(path for path in DATA.glob(pattern) if path.suffix in (".pcd", ".bin", ".npy", ".laz"))[:3]
    code, out, err = said(capsys, *map(str, paths), "--json")
    assert code == 0, err
    found = json.loads(out)
    up = found["sensor"]["elevations_deg"]
    assert found["rings_by"] == way
    assert (up[0], up[-1]) == pytest.approx((low_deg, high_deg), abs=1.0)
    assert rings is None or len(up) == pytest.approx(rings, abs=3 if name == "hilti" else 0)
    assert known <= set(found["presets"])
    assert known or "thinned" in " ".join(found["notes"])


def test_deskewed_scans_of_one_sensor_are_not_refused(capsys):
    """Some show 64 rings, some 47, as a moving sensor's rings run together, and most show none."""
    recorded("hilti_hall_indoor")
    paths = sorted((DATA / "hilti_hall_indoor/queries").glob("scan_*4.pcd"))
    assert len(paths) == 9
    code, out, err = said(capsys, *map(str, paths), "--json")
    assert code == 0, err
    assert "points that were moved" in " ".join(json.loads(out)["notes"])


def test_a_recorded_map_is_no_scan(capsys):
    recorded("hilti_hall_indoor")
    code, _, err = said(capsys, str(DATA / "hilti_hall_indoor/map_0.1m.binary.pcd"))
    assert code == 2
    assert "is no scan of one sensor" in err

"""Recordings of public data sets: scans and true poses, the choice of places, and damaged files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InputError, InvalidOption, MalformedData, NotFound
from firstfix.scan.scan import Scan
from firstfix.scan_file import read_scan_file
from firstfix.transform import from_quaternion, inverse, make_transform, pose_error, transform_points
from firstfix_builder.sources.read_map import read_map
from firstfix_lab.datasets.datasets import open_dataset
from firstfix_lab.datasets.ground_truth import GroundTruth
from firstfix_lab.datasets.helipr import RECORDS
from firstfix_lab.datasets.mapping_run import write_mapping_run
from firstfix_lab.datasets.names import Dataset
from firstfix_lab.datasets.recording import one_a_place
from lab.tests.datasets.dataset_files import (
    BEGIN_NS,
    FORMATS,
    PERIOD_NS,
    Format,
    write_helipr,
    write_hilti,
    write_mulran,
    write_nclt,
)
from tests.every_case import every_case
from tests.needs import RECORDED, with_recorded


def drive(count: int = 6) -> tuple[np.ndarray, list[tuple[Scan, np.ndarray]]]:
    """Landmarks in a map, and scans of them along a way, each tilted in its own manner."""
    rng = np.random.default_rng(3)
    landmarks = rng.uniform([-20, -20, -2], [20, 20, 6], (200, 3))
    posed = []
    for k in range(count):
        T = from_quaternion([1.5 * k - 4, 0.5 * k, 1.2], [0.02 * k, -0.01, np.sin(0.2 * k), np.cos(0.2 * k)])
        posed.append((Scan.from_points(transform_points(inverse(T), landmarks)), T))
    return landmarks, posed


@pytest.mark.parametrize("name", FORMATS)
def test_scans_at_their_true_poses_lie_on_the_map(name: str, tmp_path: Path):
    """Exact geometry: frames of body and sensor, axes, times, and number types of each format."""
    form: Format = FORMATS[name]
    landmarks, posed = drive()
    path = form.write(tmp_path, posed)
    recording = open_dataset(Dataset(form.dataset), path, form.lidar)
    assert recording.without_pose == 0
    assert np.all(np.diff(recording.stamps_ns) == PERIOD_NS)
    read = list(recording.read(np.arange(len(posed))))
    assert len(read) == len(posed)
    for found, (_, T_map_sensor) in zip(read, posed, strict=True):
        off_m, off_deg = pose_error(T_map_sensor, found.T_map_sensor)
        assert off_m < 1e-3, found.name
        assert off_deg < 0.01, found.name
        in_map = transform_points(found.T_map_sensor, found.scan.points)
        assert np.abs(in_map - landmarks).max() < 0.004 + form.step_m, found.name


def test_only_the_chosen_scans_are_read(tmp_path: Path):
    _, posed = drive()
    path = write_mulran(tmp_path, posed)
    opened = open_dataset(Dataset.mulran, path)
    (path / "Ouster" / f"{BEGIN_NS}.bin").write_bytes(b"cut")
    assert [each.name for each in opened.read(np.array([2, 4]))] == [
        str(path / "Ouster" / f"{BEGIN_NS + k * PERIOD_NS}.bin") for k in (2, 4)
    ]
    with pytest.raises(InputError, match=rf"{BEGIN_NS}\.bin: "):
        list(opened.read(np.array([0])))


def test_aeva_without_intensity_before_a_date(tmp_path: Path):
    """The data set's tools change the record at a time of the recording."""
    _, posed = drive(2)
    drive_folder = write_helipr(tmp_path, posed, "Aeva")
    scans = drive_folder / "LiDAR" / "Aeva"
    for path in list(scans.iterdir()):
        body = path.read_bytes()
        records = [body[k : k + 25] for k in range(0, len(body), 29)]
        (scans / f"{int(path.stem) - 10**17}.bin").write_bytes(b"".join(records))
        path.unlink()
    truth = drive_folder / "LiDAR_GT" / "global_Aeva_gt.txt"
    rows = [line.split(" ", 1) for line in truth.read_text().splitlines()]
    truth.write_text("".join(f"{int(stamp) - 10**17} {pose}\n" for stamp, pose in rows))
    first = next(open_dataset(Dataset.helipr, drive_folder).read(np.array([0])))
    assert np.abs(first.scan.points - posed[0][0].points).max() < 1e-5


@pytest.mark.parametrize("lidar", RECORDS)
def test_the_times_of_heliprs_points(lidar: str, tmp_path: Path):
    _, posed = drive(1)
    path = write_helipr(tmp_path, posed, lidar)
    records = np.zeros(500, RECORDS[lidar])
    records["x"] = np.linspace(5, 10, 500)
    sweep_s = np.linspace(0, 0.0999, 500)
    name = next(name for name in records.dtype.names or () if name.startswith("time"))
    records[name] = sweep_s * (1e9 if name == "time_ns" else 1)
    next((path / "LiDAR" / lidar).iterdir()).write_bytes(records.tobytes())
    scan = next(open_dataset(Dataset.helipr, path).read(np.array([0]))).scan
    np.testing.assert_allclose(scan.time_s, sweep_s, atol=1e-6)


def test_poses_between_times():
    turned = from_quaternion([2.0, 0, 0], [0, 0, np.sin(0.4), np.cos(0.4)])
    truth = GroundTruth.of(
        Path("poses"), np.array([100_000_000, 0, 900_000_000]), np.array([turned, np.eye(4), np.eye(4)])
    )
    quarter = truth.at(25_000_000)
    assert quarter is not None
    expected = from_quaternion([0.5, 0, 0], [0, 0, np.sin(0.1), np.cos(0.1)])
    assert np.allclose(quarter, expected, atol=1e-12)
    assert truth.at(500_000_000) is None  # no pose for 0.8 s
    assert np.array_equal(truth.at(110_000_000), turned)  # the nearest, 10 ms away
    assert np.array_equal(truth.at(-15_000_000), np.eye(4))
    assert truth.at(-30_000_000) is None
    assert truth.at(930_000_000) is None


def test_a_turn_over_half_a_circle_takes_the_short_way():
    angles = np.radians([175.0, -175.0])
    poses = np.array([from_quaternion(np.zeros(3), [0, 0, np.sin(a / 2), np.cos(a / 2)]) for a in angles])
    middle = GroundTruth(np.array([0, 200]), poses).at(100)
    assert middle is not None
    assert np.allclose(middle[0, 0], -1, atol=1e-12)


def test_scans_without_a_true_pose_are_counted(tmp_path: Path):
    _, posed = drive()
    path = write_mulran(tmp_path, posed)
    lines = (path / "global_pose.csv").read_text().splitlines()
    (path / "global_pose.csv").write_text("\n".join(lines[:3]) + "\n")
    opened = open_dataset(Dataset.mulran, path)
    assert (len(opened.stamps_ns), opened.without_pose) == (3, 3)


def test_one_scan_a_place():
    rng = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (500, 1, 1))
    poses[:, :2, 3] = rng.uniform(-20, 20, (500, 2))
    poses[400:, :2, 3] = 1.0  # the robot waits: one place, whatever its time
    chosen = one_a_place(poses, 5.0, seed=1)
    cells = {tuple(cell) for cell in np.floor(poses[:, :2, 3] / 5).astype(int)}
    assert (
        len(chosen) == len(cells) == len({tuple(c) for c in np.floor(poses[chosen, :2, 3] / 5).astype(int)})
    )
    assert np.all(np.diff(chosen) > 0)
    assert np.array_equal(chosen, one_a_place(poses, 5.0, seed=1))
    assert not np.array_equal(chosen, one_a_place(poses, 5.0, seed=2))
    with pytest.raises(InvalidOption, match="over 0 m"):
        one_a_place(poses, 0.0, seed=1)


@pytest.mark.parametrize(
    ("voxel_m", "max_range_m", "why"),
    [(0.0, 60.0, "over 0 m"), (0.1, np.inf, "over 0 m"), (1e-6, 60.0, "too small for a range of 60 m")],
)
def test_lengths_that_no_scan_can_be_thinned_by_are_refused(tmp_path: Path, voxel_m, max_range_m, why):
    with pytest.raises(InvalidOption, match=why):
        write_mapping_run(tmp_path / "run", [], voxel_m, max_range_m)
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (353_000.0, 4_025_000.0, 20.0)])
def test_a_map_of_a_recording_is_read_by_the_builder(origin, tmp_path: Path):
    """Joined, exact in UTM, and with the poses of the mapping run."""
    landmarks, posed = drive()
    T_map_local = make_transform(np.eye(3), origin)
    path = write_mulran(tmp_path, [(scan, T_map_local @ T) for scan, T in posed])
    opened = open_dataset(Dataset.mulran, path)
    folder = tmp_path / "map"
    count, _ = write_mapping_run(folder, opened.read(np.arange(6)), voxel_m=0.02, max_range_m=100)
    assert count == 6
    found = read_map(folder)
    assert found.points is not None
    assert found.trajectory is not None
    in_map = found.points + found.origin
    distances = np.linalg.norm(in_map[:, None] - (landmarks + origin), axis=2)
    assert distances.min(axis=1).max() < 0.005
    assert distances.min(axis=0).max() < 0.03  # each landmark is there
    assert len(in_map) < 2 * len(landmarks)  # of six scans
    for T, (_, T_local_sensor) in zip(found.trajectory, posed, strict=True):
        assert np.abs(T[:3, 3] + found.origin - (T_map_local @ T_local_sensor)[:3, 3]).max() < 1e-3


def test_far_points_do_not_enter_a_map(tmp_path: Path):
    _, posed = drive(1)
    opened = open_dataset(Dataset.mulran, write_mulran(tmp_path, posed))
    folder = tmp_path / "map"
    _, count = write_mapping_run(folder, opened.read(np.array([0])), voxel_m=0.02, max_range_m=8.0)
    points = np.load(folder / "mapping_scans" / "000000.npy")
    near = np.linalg.norm(posed[0][0].points, axis=1) <= 8.0
    assert len(points) == count == near.sum() > 0
    assert np.linalg.norm(points, axis=1).max() <= 8.0


def _without(name: str, folder: Path) -> Path:
    _, posed = drive(2)
    path = write_mulran(folder, posed)
    (path / name).rename(folder / "elsewhere")
    return path


def _with_truth(folder: Path, text: str) -> Path:
    _, posed = drive(2)
    path = write_mulran(folder, posed)
    (path / "global_pose.csv").write_text(text)
    return path


ROW = ",".join(["1", "0", "0", "5", "0", "1", "0", "6", "0", "0", "1", "7"])
BAD_TRUTHS = [
    ("", "not of 13"),
    ("1,2,3\n", "3 numbers, not of 13"),
    (f"{BEGIN_NS},{ROW}\n{BEGIN_NS},x{ROW}\n", "row 2"),
    (f"{BEGIN_NS},{ROW.replace('1', '3', 1)}\n", "not a rigid transform"),
    (f"{BEGIN_NS},{ROW.replace('5', 'nan')}\n", "not finite"),
    (f"nan,{ROW}\n", "has no time"),
    (f"1e30,{ROW}\n", "has no time"),
    (f"12,{ROW}\n", "none of the 2 scans has a true pose"),
]


@every_case("text, said", BAD_TRUTHS)
def test_damaged_ground_truth_is_a_clear_error(
    text: str, said: str, tmp_path_factory: pytest.TempPathFactory
):
    path = _with_truth(tmp_path_factory.mktemp("drive"), text)
    with pytest.raises((MalformedData, NotFound), match=said):
        open_dataset(Dataset.mulran, path)


@every_case(
    "make, error, said",
    [
        (lambda folder: folder / "none", NotFound, "no such folder"),
        (lambda folder: _without("Ouster", folder), NotFound, "Ouster: no such folder"),
        (lambda folder: _without("global_pose.csv", folder), NotFound, "no such file: .*global_pose.csv"),
    ],
)
def test_what_is_missing_is_named(make, error, said, tmp_path_factory: pytest.TempPathFactory):
    with pytest.raises(error, match=said):
        open_dataset(Dataset.mulran, make(tmp_path_factory.mktemp("drive")))


def test_names_without_a_time(tmp_path: Path):
    _, posed = drive(2)
    path = write_mulran(tmp_path, posed)
    (path / "Ouster" / "first.bin").write_bytes(b"")
    with pytest.raises(MalformedData, match=r"first\.bin: the name gives no time"):
        open_dataset(Dataset.mulran, path)


def test_of_several_lidars_one_must_be_chosen(tmp_path: Path):
    _, posed = drive(2)
    write_helipr(tmp_path, posed, "Ouster")
    path = write_helipr(tmp_path, posed, "Avia")
    with pytest.raises(InvalidOption, match=r"several LiDARs.*Avia\|Ouster"):
        open_dataset(Dataset.helipr, path)
    assert len(open_dataset(Dataset.helipr, path, "avia").stamps_ns) == 2
    with pytest.raises(InvalidOption, match="no LiDAR 'mid360'"):
        open_dataset(Dataset.helipr, path, "mid360")
    with pytest.raises(InvalidOption, match="mulran has one LiDAR"):
        open_dataset(Dataset.mulran, path, "Ouster")


def test_cut_records_are_named(tmp_path: Path):
    _, posed = drive(2)
    path = write_helipr(tmp_path, posed, "Velodyne")
    cut = path / "LiDAR" / "Velodyne" / f"{BEGIN_NS}.bin"
    cut.write_bytes(cut.read_bytes()[:-3])
    with pytest.raises(MalformedData, match=rf"{BEGIN_NS}\.bin: HeLiPR Velodyne: .* whole records of 22"):
        list(open_dataset(Dataset.helipr, path).read(np.array([0])))


def test_a_bag_without_its_ground_truth(tmp_path: Path):
    _, posed = drive(2)
    bag = write_hilti(tmp_path, posed)
    (tmp_path / "exp_04_construction_imu.txt").rename(tmp_path / "exp14_basement_2_imu.txt")
    with pytest.raises(NotFound, match=r"no ground truth exp04_construction_imu\.txt"):
        open_dataset(Dataset.hilti, bag)


@with_recorded("formats/original")
def test_a_real_scan_of_nclt_is_seen_from_its_sensor(tmp_path: Path):
    """The data set ships points in the body's frame: from the sensor alone, they lie on 32 cones."""
    _, posed = drive(1)
    session = write_nclt(tmp_path, posed)
    real = next((RECORDED / "formats" / "original").glob("nclt_*.velodyne_sync.bin")).read_bytes()
    next((session / "velodyne_sync").iterdir()).write_bytes(real)
    points = next(open_dataset(Dataset.nclt, session).read(np.array([0]))).scan.points
    assert _share_in_rings(points) > 0.75
    assert _share_in_rings(points + [0, 0, 0.957]) < 0.5  # as shipped


@with_recorded("formats/original")
def test_a_real_scan_of_heliprs_avia(tmp_path: Path):
    """Against the decoder that knows no name, and against what such a sensor sees."""
    _, posed = drive(1)
    path = write_helipr(tmp_path, posed, "Avia")
    real = next((RECORDED / "formats" / "original").glob("helipr_avia_*.bin"))
    next((path / "LiDAR" / "Avia").iterdir()).write_bytes(real.read_bytes())
    scan = next(open_dataset(Dataset.helipr, path).read(np.array([0]))).scan
    assert np.array_equal(scan.points, read_scan_file(real).points)
    for one in (scan, read_scan_file(real)):
        assert (one.time_s.min(), one.time_s.max()) == pytest.approx((0.000320859, 0.099841705), abs=1e-8)
    away = scan.points[np.linalg.norm(scan.points, axis=1) > 1]
    azimuth_deg = np.degrees(np.arctan2(away[:, 1], away[:, 0]))
    assert np.mean(np.abs(azimuth_deg) < 36) > 0.99  # 70 degrees wide


def _share_in_rings(points: np.ndarray) -> float:
    """Share of the far points in the 32 fullest of 500 rings of 0.1 degrees of elevation."""
    elevation_deg = np.degrees(np.arctan2(points[:, 2], np.linalg.norm(points[:, :2], axis=1)))
    far = np.linalg.norm(points, axis=1) > 15
    counts, _ = np.histogram(elevation_deg[far], bins=np.arange(-35, 15, 0.1))
    return float(np.sort(counts)[-32:].sum() / far.sum())

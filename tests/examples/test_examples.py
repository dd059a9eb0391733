"""Every program of examples/ runs in a process against a real service with real maps."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from firstfix.answer.localization import Verdict
from firstfix.catalog.catalog import Catalog
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix.transform import inverse, make_transform, quaternion_of, rotation_z
from firstfix_cli.local_service import LocalService, local_service
from firstfix_client import Client, ScanSequence
from tests.storey_world import ROOMS_X, pose, scan_at, storey, storey_version
from tests.waiting import LIMIT_S

pytestmark = pytest.mark.timeout(900)  # an example may build a map

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
POSE = re.compile(r"x (\S+) y (\S+) z ([-\d.]+)")
PosedScan = tuple[Scan, NDArray[np.float64]]


@pytest.fixture(scope="module")
def service(small_version, once_a_run, tmp_path_factory: pytest.TempPathFactory) -> Iterator[LocalService]:
    """A service with the yard as ``ground`` and as ``mezzanine``, and a storey of offices."""
    root = tmp_path_factory.mktemp("examples")
    offices = storey_version(once_a_run)
    catalog = Catalog(Store.open(str(root / "store")))
    for map_id, built in (("ground", small_version), ("mezzanine", small_version), ("offices", offices)):
        catalog.publish(map_id, built.directory, built.manifest)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(root / "cache"))
        with local_service(root / "service", root / "store") as running:
            yield running


@pytest.fixture(scope="module")
def by_verdict(service: LocalService, small_scans: list[PosedScan]) -> dict[Verdict, list[PosedScan]]:
    """Scans of the yard by the verdict on their compact query."""
    found: dict[Verdict, list[PosedScan]] = {verdict: [] for verdict in Verdict}
    with Client(service.url) as client:
        for scan, T_map_sensor in small_scans:
            answer = client.localize(scan, map_id="ground", encoding="compact")
            found[answer.verdict].append((scan, T_map_sensor))
    assert len(found[Verdict.LOCALIZED]) > 10
    return found


@pytest.fixture(scope="module")
def office_drive() -> list[PosedScan]:
    """Two scans in the first room and two in the second."""
    first, second, _ = ROOMS_X
    poses = [pose(first - 0.5, 0.2, 70), pose(first + 0.6, 0.9, 50)]
    poses += [pose(second + 0.3, 0.4, -100), pose(second - 0.8, -0.3, -120)]
    world = storey()
    return [(scan_at(world, T, seed), T) for seed, T in enumerate(poses)]


def run(name: str, url: str, *arguments: object, code: int = 0) -> str:
    command = [sys.executable, str(EXAMPLES / f"{name}.py"), "--url", url, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    assert done.returncode == code, done.stdout + done.stderr
    return done.stdout + done.stderr


def saved(folder: Path, name: str, scan: Scan) -> Path:
    path = folder / f"{name}.npy"
    np.save(path, scan.points)
    return path


def written(folder: Path, drive: Iterable[tuple[Scan, NDArray[np.float64] | None]]) -> Path:
    with (folder / "drive.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["scan", "tx", "ty", "tz", "qx", "qy", "qz", "qw"])
        for number, (scan, T) in enumerate(drive):
            numbers = [""] * 7 if T is None else [*T[:3, 3], *quaternion_of(T)]
            writer.writerow([saved(folder, f"{number:02}", scan).name, *numbers])
    return folder / "drive.csv"


def away_m(line: str, T_map_sensor: NDArray[np.float64]) -> float:
    told = POSE.search(line)
    assert told is not None, line
    return float(np.linalg.norm(np.array(told.groups(), float) - T_map_sensor[:3, 3]))


@pytest.mark.slow
def test_start_up_asks_again_until_a_scan_is_localized(service, by_verdict, tmp_path):
    seen = by_verdict[Verdict.LOCALIZED]
    blocked = Scan.from_points(seen[0][0].points[:150])  # a hand before the sensor
    scans = [(blocked, seen[0][1]), *seen[:2]]
    files = [saved(tmp_path, f"{number}", scan) for number, (scan, _) in enumerate(scans)]
    first, second = run("robot_startup", service.url, "--map", "ground", *files).splitlines()
    assert first.startswith("rejected (")
    assert second.startswith("localized: ")
    assert away_m(second, scans[1][1]) < 0.05


def test_start_up_on_its_side_with_the_imu_and_without(service, by_verdict, tmp_path):
    scan, T_map_sensor = by_verdict[Verdict.LOCALIZED][0]
    on_its_side = make_transform(Rotation.from_euler("x", 80, degrees=True).as_matrix(), np.zeros(3))
    file = saved(tmp_path, "lying", Scan.from_points(scan.points @ on_its_side[:3, :3]))
    accelerometer = 9.81 * (T_map_sensor @ on_its_side)[2, :3]
    imu = "--imu=" + ",".join(f"{value:.4f}" for value in accelerometer)
    told = run("robot_startup", service.url, "--map", "ground", imu, file)
    assert away_m(told, T_map_sensor) < 0.05
    assert away_m(run("robot_startup", service.url, "--map", "ground", file), T_map_sensor) < 0.05


def test_start_up_ends_without_a_pose_where_rooms_look_alike(service, office_drive, tmp_path):
    files = [saved(tmp_path, f"{number}", scan) for number, (scan, _) in enumerate(office_drive[:2])]
    lines = run("robot_startup", service.url, "--map", "offices", *files, code=3).splitlines()
    assert lines[0] == "ambiguous (several_places): 3 places fit; turning for another view"
    assert lines[-1].startswith("no fix")
    assert not any("localized" in line for line in lines)


def test_start_up_says_that_nobody_answers(service, by_verdict, tmp_path):
    file = saved(tmp_path, "scan", by_verdict[Verdict.LOCALIZED][0][0])
    assert "no answer: " in run("robot_startup", "http://127.0.0.1:9", "--map", "ground", file, code=1)
    assert "no answer: " in run("robot_startup", service.url, "--map", "attic", file, code=1)


def test_a_kidnapped_robot_notices_and_finds_itself(service, by_verdict, tmp_path):
    seen = by_verdict[Verdict.LOCALIZED]
    before, after = seen[:3], seen[3:7]
    blinded = Scan.from_points(np.random.default_rng(0).normal(0, 0.3, (5000, 3)))  # by those who carry it
    T_odom_map = make_transform(rotation_z(0.7), [40.0, -3.0, 1.0])
    drive = [(scan, T_odom_map @ T) for scan, T in before]
    # carried: odometry sees no way between the last scan before and the first after
    carried = drive[-1][1] @ inverse(after[0][1])
    drive += [(blinded, drive[-1][1]), *((scan, carried @ T) for scan, T in after)]
    lines = run("kidnapped_robot", service.url, "--map", "ground", written(tmp_path, drive)).splitlines()
    assert lines[0].startswith("scan 0: first fix")
    assert any(line.startswith("scan 1: still on the way") for line in lines)
    (noticed,) = (line for line in lines if "carried off" in line)
    number = int(noticed.split()[1].rstrip(":"))
    assert number > len(before), "the blinded scan says nothing"
    assert lines[len(before)].endswith("stopping until more scans say more")
    assert away_m(noticed, after[number - len(before) - 1][1]) < 0.05
    metres = float(noticed.split("carried off by ")[1].split()[0])
    assert metres == pytest.approx(np.linalg.norm(after[0][1][:3, 3] - before[-1][1][:3, 3]), abs=0.3)
    assert lines[-1].startswith("scan 7: still on the way")
    assert away_m(lines[-1], after[-1][1]) < 0.05


def test_a_kidnapped_robot_follows_hints_out_of_a_room_that_looks_like_others(service, tmp_path):
    world = storey()
    poses, scans, ways_m = [pose(ROOMS_X[0], 0.0, 0)], [scan_at(world, pose(ROOMS_X[0], 0.0, 0), 4)], []
    with Client(service.url) as client:
        for seed in (54, 55):
            hint = client.localize(ScanSequence.along(scans, poses), map_id="offices").hint
            if hint is None:
                break
            ways_m.append(hint.distance_m)
            poses.append(poses[-1] @ hint.T_sensor_goal)
            scans.append(scan_at(world, poses[-1], seed))
    assert ways_m, "the rooms look alike from inside"
    drive = written(tmp_path, zip(scans, poses, strict=True))
    *lines, last = run("kidnapped_robot", service.url, "--map", "offices", drive).splitlines()
    for number, (line, way_m, goal) in enumerate(zip(lines, ways_m, poses[1:], strict=True)):
        assert line.startswith(f"scan {number}: ambiguous; drive {way_m:.1f} m to x ")
        assert away_m(line, goal) < 0.05, "the odometry of this drive is in the map's frame"
    assert last.startswith(f"scan {len(ways_m)}: first fix, ")
    assert away_m(last, poses[-1]) < 0.05


def test_a_robot_that_is_not_carried_off_never_says_so(service, by_verdict, tmp_path):
    drive = by_verdict[Verdict.LOCALIZED][:5]
    told = run("kidnapped_robot", service.url, "--map", "ground", written(tmp_path, drive))
    assert "carried off" not in told
    assert "still on the way" in told


def test_scans_that_are_ambiguous_alone_are_localized_together(service, office_drive, tmp_path):
    drive = [(scan, make_transform(rotation_z(-0.4), [5, 6, 0]) @ T) for scan, T in office_drive]
    lines = run("several_scans", service.url, "--map", "offices", written(tmp_path, drive)).splitlines()
    assert [line for line in lines if "alone" in line] == [f"scan {n} alone: ambiguous" for n in range(4)]
    assert sum(line.startswith("    maybe ") for line in lines) == 12
    assert lines[-1].startswith("together: localized")
    assert away_m(lines[-1], office_drive[-1][1]) < 0.05
    alone = run("several_scans", service.url, "--map", "offices", written(tmp_path, drive[:2]), code=3)
    assert "together" not in alone


def test_the_floor_of_an_elevator(service, by_verdict, tmp_path):
    scan, T_map_sensor = by_verdict[Verdict.LOCALIZED][0]
    file = saved(tmp_path, "doors", scan)
    told = run("elevator", service.url, "--floors", "offices,ground", file).splitlines()
    assert told[0].startswith("map ground: ")
    assert away_m(told[0], T_map_sensor) < 0.05
    assert told[1] == "again, on this map alone: localized"
    # all maps: two floors are built alike, and naming one helps
    assert run("elevator", service.url, file, code=3).startswith(
        "ambiguous: floors ground, mezzanine look alike here"
    )
    assert run("elevator", service.url, "--floors", "mezzanine", file).startswith("map mezzanine: ")
    assert run("elevator", service.url, "--floors", "attic", file, code=2).endswith(
        "the service has ground, mezzanine, offices\n"
    )


def test_an_elevator_that_opens_nowhere(service, tmp_path):
    dust = Scan.from_points(np.random.default_rng(0).normal(0, 0.3, (5000, 3)))
    told = run("elevator", service.url, saved(tmp_path, "dust", dust), code=4)
    assert told.startswith("rejected: ")


def test_an_evaluation_of_a_drive(service, small_scans, office_drive, tmp_path):
    outside = [(scan, None) for scan, _ in office_drive[:2]]
    poses = written(tmp_path, [*small_scans[:10], *outside])
    told = run("evaluate_drive", service.url, "--map", "ground", poses)
    assert told.startswith("12 scans, 10 of them in the map, ")
    success = re.search(r"success: (\d+) of 10 localized within 0.2 m", told)
    assert success is not None
    assert int(success.group(1)) >= 7
    error = re.search(r"error: (\S+) cm at the median; 0 localized and wrong", told)
    assert error is not None
    assert float(error.group(1)) < 5
    sure = re.search(r"reliability: (\d+) scans said 1.00, 1.00 of them are right", told)
    assert sure is not None
    assert int(sure.group(1)) >= 7


def test_an_evaluation_finds_confident_wrong_answers(service, by_verdict, tmp_path):
    off = make_transform(np.eye(3), [5.0, 0, 0])
    poses = written(tmp_path, [(scan, off @ T) for scan, T in by_verdict[Verdict.LOCALIZED][:3]])
    told = run("evaluate_drive", service.url, "--map", "ground", poses, code=1)
    assert "success: 0 of 3" in told
    assert "3 localized and wrong" in told


def test_they_need_the_client_alone():
    """The examples need only numpy, httpx and zstandard."""
    blocked = [
        "scipy",
        "faiss",
        "pydantic",
        "zenoh",
        "yaml",
        "firstfix_service",
        "firstfix_builder",
        "firstfix_cli",
    ]
    for path in sorted(EXAMPLES.glob("*.py")):
        program = f"import runpy, sys\nfor name in {blocked}: sys.modules[name] = None\n"
        program += f"sys.path.insert(0, {str(EXAMPLES)!r}); sys.argv = ['x', '--help']\n"
        program += f"runpy.run_path({str(path)!r})"
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{path.name}: {done.stderr}"


def test_every_example_is_listed_and_fits_a_page():
    listed = (EXAMPLES / "README.md").read_text()
    for path in EXAMPLES.glob("*.py"):
        assert f"[{path.name}]({path.name})" in listed
        assert len(path.read_text().splitlines()) <= 60

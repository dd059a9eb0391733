"""The parts of the comparison with other systems that need none of them."""

from __future__ import annotations

import sys
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from benchmarks.common.datasets import Dataset, PoseTable
from benchmarks.peers import bbs
from benchmarks.peers.figures import figures_of
from benchmarks.peers.peer_input import PeerInput
from benchmarks.peers.report import report
from benchmarks.peers.suite import queries_of
from benchmarks.peers.trial import LIMIT_S, Found
from benchmarks.run import main
from firstfix.scan.scan import Scan
from firstfix.transform import from_quaternion, inverse, make_transform, pose_error, transform_points

HERE = np.eye(4)
TABLES = {"truth": PoseTable("eval.csv")}, PoseTable("trajectory.csv")


def moved(x_m: float) -> np.ndarray:
    return make_transform(np.eye(3), [x_m, 0, 0])


def test_a_wrong_answer_is_not_the_same_as_none():
    found = [
        Found(moved(0.1), 1.0),
        Found(moved(0.7), 2.0),
        Found(moved(5.0), 3.0),
        Found(None, 4.0),
        Found(None, LIMIT_S),
    ]
    figures = figures_of([HERE] * 5, found)
    assert (figures["success_0.2m_1deg"], figures["success_1m_5deg"]) == (0.2, 0.4)
    assert (figures["wrong"], figures["no_answer"], figures["timed_out"]) == (1, 2, 1)
    assert figures["wrong_0.2m"] == 2
    assert figures["median_error_m"] == pytest.approx(0.7)
    assert figures["median_s"] == 3.0


def test_a_peer_without_any_answer_has_no_error():
    assert figures_of([HERE], [Found(None, 1.0)])["median_error_m"] is None


def test_the_report_says_what_was_asked_and_what_was_skipped():
    row = {**figures_of([HERE], [Found(HERE, 1.0)]), "preparation_s": 0.5}
    text = report({"hall": {"asked": ["a.pcd"], "one": row, "other": "skipped: gone"}, "yard": "skipped"})
    assert "1 scans: a.pcd" in text
    assert "| one | 1.0 | 1.0 | 0 | 0 | 0 | 0 | 0.0 | 1.0 | 1.0 | 0.5 |" in text
    assert "| other | skipped: gone |" in text
    assert "### yard\n\nskipped" in text


def test_queries_are_drawn_by_a_seed_and_turned(tmp_path: Path):
    points = np.random.default_rng(1).uniform(-5, 5, (50, 3))
    rows = []
    for number in range(8):
        np.savetxt(tmp_path / f"{number}.xyz", points, fmt="%.4f")
        rows.append(f"{number}.xyz,{number},0,0,0.1,0,0,0.99498744")
    (tmp_path / "eval.csv").write_text("\n".join(["scan,tx,ty,tz,qx,qy,qz,qw", *rows]) + "\n")
    dataset = Dataset("place", ".", "", "{}", *TABLES, "vlp-16", root=tmp_path)
    few, again = (queries_of(dataset, 3, tmp_path) for _ in range(2))
    assert [q.name for q in few] == [q.name for q in again]
    assert len(queries_of(dataset, 99, tmp_path)) == 8
    for query in few:
        true = from_quaternion([float(query.name[0]), 0, 0], [0.1, 0, 0, 0.99498744])
        seen = transform_points(query.T_map_sensor, query.scan.points)
        np.testing.assert_allclose(seen, transform_points(true, points), atol=1e-3)  # files have 0.1 mm
        np.testing.assert_allclose(query.T_map_sensor[:3, :3] @ query.gravity, [0, 0, -1], atol=1e-6)


@pytest.mark.parametrize("prefix", [None, "empty"])
def test_a_missing_library_is_named(prefix, tmp_path: Path):
    reason = bbs.why_not(None if prefix is None else tmp_path)
    assert reason is not None
    assert "--bbs" in reason if prefix is None else "libcpu_bbs3d.so" in reason


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["real", "--bbs", "x"], "--bbs belongs to peers, not to real"),
        (["real", "--sets", "hall,moon"], "moon"),
        (["peers", "--scans", "0"], "above 0"),
    ],
)
def test_options_that_make_no_sense_are_refused(arguments, message, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["benchmarks.run", *arguments])
    with pytest.raises(SystemExit):
        main()
    assert message in capsys.readouterr().err


# What bbs_driver.cpp reads and writes; it says that it found the place half a metre aside.
STAND_IN = """#!{python}
import sys
import numpy as np
assert len(np.fromfile(sys.argv[1], "<f8")) % 3 == 0 and len(sys.argv) == 7
sys.stdout.write("ready\\n"); sys.stdout.flush()
while head := sys.stdin.buffer.read(8):
    count = int(np.frombuffer(head, "<u8")[0])
    points = np.frombuffer(sys.stdin.buffer.read(24 * count), "<f8").reshape(count, 3)
    pose = np.eye(4)
    pose[:3, 3] = {at}
    levelled = abs(np.percentile(points[:, 2], 2) + 1.0) < 0.3
    sys.stdout.buffer.write(np.array([float(levelled), *pose.ravel()], "<f8").tobytes()); sys.stdout.flush()
"""


def test_a_levelled_scan_goes_to_the_driver_and_its_pose_is_refined(tmp_path: Path):
    rng = np.random.default_rng(2)
    floor, walls = (
        rng.uniform([-9, -6, 0], [9, 6, 0], (30_000, 3)),
        rng.uniform([-9, -6, 0], [9, 6, 3], (30_000, 3)),
    )
    walls[::2, 0], walls[1::2, 1] = np.sign(walls[::2, 0]) * 9, np.sign(walls[1::2, 1]) * 6
    points = np.concatenate([floor, walls])
    true = from_quaternion(
        [1.0, 2.0, 1.0], [0.15, -0.1, 0.0, 0.98361578]
    )  # rolled and pitched, without a turn
    driver = tmp_path / "driver"
    driver.write_text(STAND_IN.format(python=sys.executable, at=[1.4, 1.8, 1.0]))
    driver.chmod(0o755)
    dataset = Dataset("place", ".", "", "{}", *TABLES, "vlp-16", root=tmp_path)
    given = PeerInput(dataset, tmp_path, tmp_path, 0.5, 0.5, 0.5, 0.1, driver)
    np.save(tmp_path / "map.npy", points)
    scan = Scan.from_points(transform_points(inverse(true), points[::5]))
    with closing(bbs.Bbs(given)) as peer:
        found = peer(scan, true[:3, :3].T @ [0.0, 0.0, -1.0])
        assert found is not None
        off_m, off_deg = pose_error(true, found)
        assert off_m < 0.05
        assert off_deg < 0.5
        assert peer(scan, np.array([1.0, 0.0, 0.0])) is None  # on its side: the driver finds nothing

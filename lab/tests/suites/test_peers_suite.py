"""The parts of the comparison with other systems that need none of them."""

from __future__ import annotations

import sys
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.scan.scan import Scan
from firstfix.transform import from_quaternion, inverse, make_transform, pose_error, transform_points
from firstfix_lab.figures import main
from firstfix_lab.suites.peers import bbs
from firstfix_lab.suites.peers.answer import Answer
from firstfix_lab.suites.peers.bbs2d import RESOLUTION_M, GridPyramid
from firstfix_lab.suites.peers.figures import answer_row, figures_of
from firstfix_lab.suites.peers.peer_input import PeerInput
from firstfix_lab.suites.peers.prior import POSITION_OFF_M, Prior
from firstfix_lab.suites.peers.quick_place import QUICK
from firstfix_lab.suites.peers.report import COLUMNS, OURS, all_sets, report, table_of, wins
from firstfix_lab.suites.peers.suite import PEERS, queries_of, run
from firstfix_lab.suites.peers.trial import LIMIT_S, Found, Preparation
from tests.recorded_data import Dataset, PoseTable

HERE = np.eye(4)
TABLES = {"truth": PoseTable("eval.csv")}, PoseTable("trajectory.csv")


def moved(x_m: float) -> np.ndarray:
    return make_transform(np.eye(3), [x_m, 0, 0])


def figures(*answers: Answer, seconds: float = 1.0) -> dict[str, Any]:
    """Of answers to scans whose true pose is HERE."""
    rows = [answer_row(HERE, Found(answer, seconds, 0.5 * seconds), 1000) for answer in answers]
    return figures_of(rows, Preparation(0.5, 0.25, 3_000_000), 5_000_000)


def test_a_wrong_answer_is_not_the_same_as_none_nor_as_one_that_is_not_vouched_for():
    found = figures(
        Answer(moved(0.1), 9.0, True),
        Answer(moved(0.15), 2.0, False),
        Answer(moved(0.7), 8.0, True),
        Answer(moved(1.5), 3.0, True),
        Answer(moved(5.0), 1.0, False),
        Answer(),
    )
    assert [found[key] for key in list(COLUMNS)[:3]] == [0.1667, 0.3333, 0.5]
    assert found["right_first"] == 0.3333
    assert (found["accepted"], found["false_accepts"], found["no_pose"]) == (3, 1, 1)
    assert found["coverage_at_risk_0"] == 0.3333  # the third surest is wrong
    assert found["median_error_m"] == pytest.approx(0.7)
    assert (found["median_s"], found["median_cpu_s"], found["timed_out"]) == (1.0, 0.5, 0)
    assert (found["preparation_peak_mb"], found["peak_mb"], found["median_sent_bytes"]) == (3, 5, 1000)


def test_a_peer_without_any_answer_has_no_error():
    none = figures(Answer(), seconds=LIMIT_S)
    assert none["median_error_m"] is None
    assert none["timed_out"] == 1


def test_the_report_says_what_was_asked_and_what_was_skipped():
    one = figures(Answer(HERE, 1.0, True))
    text = report({"hall": {"asked": ["a.pcd"], "one": one, "other": "skipped: gone"}, "yard": "skipped"})
    assert "1 scans: a.pcd" in text
    assert text.count("| one (1) | 1.0 | 1.0 | 1.0 | 1.0 | 1 | 0 | 0 | 1.0 | 0.0 |") == 2
    assert "* other: skipped: gone" in text
    assert "### yard\n\nskipped" in text


def test_where_a_peer_wins_is_said_first_and_of_the_sets_that_both_were_asked_in():
    right, missed = Answer(HERE, 1.0, True), Answer()
    cheap = figures(missed, seconds=0.01)
    hall = {"asked": ["a"], OURS[0]: figures(missed), "one": figures(right), "two": cheap}
    street = {"asked": ["b"], OURS[0]: figures(right), "two": cheap}
    lines = wins({"hall": hall, "street": street})
    assert lines[2] == "* success within 0.2 m and 1 deg: one 1.0 against 0.0"
    assert not [line for line in lines if "two" in line]  # it finds nothing
    both = wins({"hall": {**hall, "three": figures(right)}, "street": street})
    assert both[2] == "* success within 0.2 m and 1 deg: one 1.0 against 0.0 (and 1 more)"
    assert wins({"street": street}) == ["No other system wins anywhere."]
    rows = all_sets({"hall": hall, "street": street, "seed": 1})
    assert {peer: row["n"] for peer, row in rows.items()} == {OURS[0]: 2, "one": 1, "two": 2}
    assert rows["two"]["preparation_s"] == 1.0
    assert table_of(rows)[2].startswith("| one (1) | 1.0 |")


def test_branch_and_bound_finds_what_a_full_search_finds():
    rng = np.random.default_rng(3)
    walls = rng.uniform(0, 40, (400, 2))
    walls[::2, 0], walls[1::2, 1] = np.round(walls[::2, 0] / 13) * 13, np.round(walls[1::2, 1] / 9) * 9
    grid = GridPyramid(np.repeat(walls, 5, axis=0), 20.0)
    occupied = set(map(tuple, np.floor(walls / RESOLUTION_M).astype(int)))
    near = walls[np.linalg.norm(walls - [21.0, 17.0], axis=1) < 12] - [21.0, 17.0]
    turn = np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])
    x_m, y_m, yaw_rad, share = grid.search(near @ turn)
    assert np.hypot(x_m - 21.0, y_m - 17.0) < 0.75
    assert abs(yaw_rad - 0.7) < 0.03

    def share_at(x: float, y: float, yaw: float) -> float:
        to_map = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
        cells = np.floor(near @ turn @ to_map.T / RESOLUTION_M).astype(int)
        cells += np.floor(np.array([x, y]) / RESOLUTION_M).astype(int)
        return float(np.mean([tuple(cell) in occupied for cell in cells]))

    assert share == pytest.approx(share_at(x_m + 0.01, y_m + 0.01, yaw_rad))
    for x, y in rng.uniform(0, 40, (300, 2)):
        assert share_at(x, y, yaw_rad) <= share


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_quick_suite_asks_every_peer_that_is_there():
    found = run(quick=True)[QUICK]
    assert found.keys() == {"asked", *PEERS}
    assert len(found["asked"]) == 3
    for peer in ("Scan Context + our registration, gravity given", "FPFH + RANSAC (Open3D) + ICP"):
        assert len(found[peer]["answers"]) == 3
    for peer in (*OURS, "BBS 2-D (hdl) + ICP, gravity given"):
        assert found[peer]["right_first"] == 1.0
        assert found[peer]["false_accepts"] == 0
        assert found[peer]["preparation_cpu_s"] > 0
        assert found[peer]["median_sent_bytes"] > 1000


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
        np.testing.assert_allclose(query.T_map_sensor[:3, :3] @ query.prior.gravity, [0, 0, -1], atol=1e-6)
        assert 0 < np.linalg.norm(query.prior.position - query.T_map_sensor[:2, 3]) <= POSITION_OFF_M


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
    with pytest.raises(SystemExit):
        main(arguments)
    assert message in capsys.readouterr().err


# What bbs_driver.cpp reads and writes; it found nine tenths of the scan half a metre aside.
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
    sys.stdout.buffer.write(np.array([0.9 * levelled, *pose.ravel()], "<f8").tobytes()); sys.stdout.flush()
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
    given = PeerInput(dataset, tmp_path, tmp_path, tmp_path, 0.5, 0.5, 0.5, 0.1, driver)
    np.save(tmp_path / "map.npy", points)
    scan = Scan.from_points(transform_points(inverse(true), points[::5]))
    with closing(bbs.Bbs(given)) as peer:
        found = peer(scan, Prior(true[:3, :3].T @ [0.0, 0.0, -1.0], np.zeros(2)))
        assert (found.confidence, found.is_accepted) == (0.9, True)
        assert found.T_map_sensor is not None
        off_m, off_deg = pose_error(true, found.T_map_sensor)
        assert off_m < 0.05
        assert off_deg < 0.5
        on_its_side = Prior(np.array([1.0, 0.0, 0.0]), np.zeros(2))
        assert peer(scan, on_its_side) == Answer()  # the driver finds nothing

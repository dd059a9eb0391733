"""Data sets in both layouts, and the figures of a small world's scans."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.transform import make_transform, quaternion_of
from firstfix_cli.poses_csv import read_poses_csv
from firstfix_cli.sample_world.write_world import pcd_of_points
from firstfix_lab.common.asked import Asked, figures_of
from firstfix_lab.common.nees import nees_by_class
from firstfix_lab.scoreboard.pages import PLOTS, benchmark_page, plot_files
from firstfix_lab.scoreboard.result import Cases, Result
from firstfix_lab.suites.real.ask import GRAVITY
from firstfix_lab.suites.real.report import report
from firstfix_lab.suites.real.strangers import ask_strangers
from firstfix_lab.suites.real.suite import _write_answers, in_process
from tests.recorded_data import Dataset, PoseTable
from tests.small_world import SENSOR

POSES = "tx,ty,tz,qx,qy,qz,qw"
NUMBERED = f"""scan,split,{POSES},fine_tx,fine_ty,fine_tz,fine_qx,fine_qy,fine_qz,fine_qw
0,map,0,0,0,0,0,0,1,,,,,,,
1,query,1,0,0,0,0,0,1,1.5,0,0,0,0,0,1
2,map_thin,2,0,0,0,0,0,1,,,,,,,
3,query,3,0,0,0,0,0,1,3.5,0,0,0,0,0,1
"""


def numbered(root: Path) -> Dataset:
    """One table with numbers of scans, two poses and splits. The file of scan 3 is not there."""
    folder = root / "place"
    (folder / "queries").mkdir(parents=True)
    (folder / "poses.csv").write_text(NUMBERED)
    (folder / "queries" / "scan_001.pcd").touch()
    references = {
        "fine": PoseTable("poses.csv", "fine_", ("query",)),
        "raw": PoseTable("poses.csv", "", ("query",)),
    }
    trajectory = PoseTable("poses.csv", splits=("map", "map_thin"))
    return Dataset(
        "place", "place", "map.laz", "queries/scan_{:0>3}.*", references, trajectory, "vlp-16", root=root
    )


def test_a_table_of_numbered_scans(tmp_path: Path):
    dataset = numbered(tmp_path)
    assert dataset.write_trajectory(tmp_path / "t.csv").read_text().split() == [
        POSES,
        "0,0,0,0,0,0,1",
        "2,0,0,0,0,0,1",
    ]
    for reference, x_m in ((None, 1.5), ("fine", 1.5), ("raw", 1.0)):
        (row,) = read_poses_csv(dataset.write_queries(tmp_path / "q.csv", reference))
        assert row.path == tmp_path / "place" / "queries" / "scan_001.pcd"
        assert row.T_map_sensor[0, 3] == x_m
    assert dataset.config == {"sensor": "vlp-16"}


def test_tables_of_the_queries_and_of_the_trajectory(tmp_path: Path):
    folder = tmp_path / "place"
    (folder / "queries").mkdir(parents=True)
    (folder / "queries" / "far.pcd").touch()
    (folder / "eval.csv").write_text(f"scan,{POSES}\nqueries/far.pcd,7,0,0,0,0,0,1\n")
    (folder / "trajectory.csv").write_text(f"{POSES}\n4,0,0,0,0,0,1\n")
    (folder / "sensor.yaml").write_text("preset: vlp-16\nmount_height_m: 2.0\n")
    tables = {"ICP": PoseTable("eval.csv")}, PoseTable("trajectory.csv")
    dataset = Dataset(
        "place", "place", "map.laz", "{}", *tables, "sensor.yaml", {"spacing_m": 2.0}, root=tmp_path
    )
    (row,) = read_poses_csv(dataset.write_queries(tmp_path / "q.csv"))
    assert row.path == folder / "queries" / "far.pcd"
    assert row.T_map_sensor[0, 3] == 7
    assert dataset.write_trajectory(tmp_path / "t.csv").read_text().split() == [POSES, "4,0,0,0,0,0,1"]
    assert dataset.config == {
        "sensor": {"preset": "vlp-16", "mount_height_m": 2.0},
        "viewpoints": {"spacing_m": 2.0},
    }


def test_a_data_set_is_converted_into_a_folder_of_its_own(tmp_path: Path):
    def convert(source: Path, out: Path) -> None:
        (out / "eval.csv").write_text((source / "raw.csv").read_text())

    (tmp_path / "place").mkdir()
    (tmp_path / "place" / "raw.csv").write_text("as it was")
    tables = {"ICP": PoseTable("eval.csv")}, PoseTable("trajectory.csv")
    raw = Dataset("turning", "place", "map.xyz", "{}", *tables, "mid-360", root=tmp_path, convert=convert)
    ready = raw.converted(tmp_path / "work")
    assert (ready.path / "eval.csv").read_text() == "as it was"
    assert ready.path == tmp_path / "work" / "turning"
    assert ready.converted(tmp_path / "again") is ready


def answered(off_m: float, verdict: Verdict = Verdict.LOCALIZED, first_off_m: float = 0.0) -> Asked:
    """An answer ``off_m`` from the first reference; the second is half a metre further on."""
    poses = [make_transform(np.eye(3), [x, 0, 0]) for x in (first_off_m or off_m, off_m)]
    hypotheses = tuple(Hypothesis(T, None, 0.5, 0) for T in poses)
    localized = verdict is Verdict.LOCALIZED
    reasons = () if localized else (Reason.SEVERAL_PLACES,)
    answer = Localization(verdict, reasons, poses[1] if localized else None, hypotheses=hypotheses)
    true = {"fine": np.eye(4), "raw": make_transform(np.eye(3), [0.5, 0, 0])}
    return Asked("scan", "as it is", "estimated", true, answer, 10.0)


def test_figures_keep_right_wrong_and_not_answered_apart():
    asked = [answered(0.1), answered(0.4), answered(3.0), answered(0.0, Verdict.AMBIGUOUS, first_off_m=9.0)]
    figures = figures_of(asked)
    assert figures["verdicts"] == {"localized": 3, "ambiguous": 1, "rejected": 0}
    assert figures["reasons"] == {"several_places": 1}
    assert (figures["wrong"], figures["wrong_0.2m"]) == (1, 2)
    fine, raw = figures["against"]["fine"], figures["against"]["raw"]
    assert (fine["right_first"], fine["right_among"], fine["localized_right"]) == (0.25, 0.5, 0.25)
    assert fine["error_m"]["p50"] == pytest.approx(0.4)
    assert (raw["right_first"], raw["localized_right"]) == (0.25, 0.25)  # the one 0.4 m off


def test_a_place_without_a_localized_scan_has_no_errors():
    figures = figures_of([answered(0.1, Verdict.AMBIGUOUS)])
    assert figures["against"]["fine"]["error_m"] is None
    assert figures["against"]["fine"]["right_first"] == 1.0


def test_scans_of_the_small_world(small_version, small_scans, tmp_path: Path):
    folder = tmp_path / "small"
    folder.mkdir()
    rows = []
    for number, (scan, T_map_sensor) in enumerate(small_scans[:4]):
        np.savetxt(folder / f"{number}.xyz", scan.points, fmt="%.4f")
        numbers = (*T_map_sensor[:3, 3], *quaternion_of(T_map_sensor))
        rows.append(",".join([f"{number}.xyz", *(f"{v:.9f}" for v in numbers)]))
    (folder / "eval.csv").write_text("\n".join([f"scan,{POSES}", *rows]) + "\n")
    (folder / "sensor.yaml").write_text(str(SENSOR))
    tables = {"truth": PoseTable("eval.csv")}, PoseTable("trajectory.csv")
    dataset = Dataset("small", "small", "", "{}", *tables, "sensor.yaml", kept_share=0.5, root=tmp_path)

    localizer = Localizer(MapIndex.load(small_version.directory))
    figures, answers = in_process(dataset, localizer, tmp_path)

    assert list(figures) == [
        "as it is",
        "sent as range_image",
        "sent as compact",
        "turned",
        "50 % of the points",
        "30 % lost in sectors",
        "rolled and pitched by 5 deg",
    ]
    assert len(answers) == 4 * 7 * len(GRAVITY)
    for by_gravity in figures.values():
        assert list(by_gravity) == list(GRAVITY)
        for found in by_gravity.values():
            assert found["n"] == 4
            assert found["wrong"] <= found["wrong_0.2m"] == 0
            assert found["against"]["truth"]["right_first"] >= 0.75
    posed = [(a.T_judged, a.answer) for a in answers if a.answer.T_map_sensor is not None]
    rows = nees_by_class(posed)
    for kind in ("shift", "turn"):
        assert sum(row["n"] for row in rows if row["kind"] == kind) == len(posed)
    found = {"build": BUILD, "over_http": {}, "variants": figures, "nees": rows, "strangers": STRANGERS}
    text = report({"small": found, "gone": "skipped: x"})
    assert text.count("| as it is (4) |") == len(GRAVITY)
    assert "### gone\n\nskipped: x" in text
    assert_pages_show(found, answers, tmp_path)


def assert_pages_show(found: dict[str, Any], answers: list[Asked], work: Path) -> None:
    """The scoreboard's pages read what the suite writes."""
    _write_answers(work / "answers.csv", {"small": answers})
    on = {"cpus": 2, "processor": "a processor", "memory_gb": 24.0, "system": "Debian", "load": 0.1}
    about = ("real", "a" * 40, {}, "a command", False, "2026-11-25", 90.0, on, {"python": "3.11"})
    result = Result(*about, {"small": found}, Cases.read(work / "answers.csv"))
    result.save(work)
    read = Result.load(work, "real")
    assert read == result
    page = benchmark_page({"real": read})
    assert f"| small | {len(answers) // 2} |" in page
    assert "Road scans of other places: 1 of 34 localized." in page
    assert set(plot_files({"real": read})) == set(PLOTS["real"])


def test_strangers_are_counted_by_their_verdicts(small_version, small_scans, tmp_path: Path):
    localizer = Localizer(MapIndex.load(small_version.directory))
    own, far = small_scans[0][0].points, np.random.default_rng(4).uniform(-20, 20, (4000, 3))
    for name, points in (("own", own), ("stranger", far)):
        (tmp_path / f"{name}.pcd").write_bytes(pcd_of_points(points))
    asked = ask_strangers(localizer, tmp_path)
    assert asked["n"] == 2
    assert asked["localized"] == ["own.pcd"]
    assert asked["verdicts"] == {"localized": 1, "rejected": 1}
    assert asked["ms_p50"] > 0


def test_without_strangers_nothing_is_asked(small_version, tmp_path: Path):
    asked = ask_strangers(Localizer(MapIndex.load(small_version.directory)), tmp_path)
    assert (asked["n"], asked["localized"], asked["ms_p50"]) == (0, [], None)


STRANGERS = {"n": 34, "verdicts": {"rejected": 33, "localized": 1}, "localized": ["a.pcd"], "ms_p50": 90.0}
BUILD = {"build_s": 3.0, "build_peak_gb": 0.1, "bytes": 2_000_000}

"""Real scans in the self-test: which fit the map, how they weigh, and a build that is given some."""

from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from firstfix.builds.config import BuildConfig, PerturbConfig
from firstfix.catalog.recorded_queries import RecordedQueries
from firstfix.scan.scan import Scan
from firstfix.store.store import Store
from firstfix.transform import make_transform, pose_to_mapping
from firstfix_builder.job.confirmed_queries import collect_confirmed
from firstfix_builder.pipeline import build_version
from firstfix_builder.self_test.real_scans import MAX_WEIGHT, RealScans, disagreeing
from firstfix_builder.self_test.reliability import FOLDS
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.sources.read_map.held_out import HeldOut, HeldOutScan
from tests.builder.fixtures import record_query
from tests.small_world import COARSE_CONFIG, SmallWorld

WALL = np.random.default_rng(3).uniform([-5, 2.0, 0], [5, 2.0, 3], (4000, 3))


def held_out(*shifts_m: float) -> HeldOut:
    scan = Scan.from_points(WALL.astype(np.float32))
    named = enumerate(shifts_m)
    scans = tuple(HeldOutScan(f"{n}", scan, make_transform(np.eye(3), [0, by, 0])) for n, by in named)
    return HeldOut(scans, {"lost": "it has no pose"})


def test_poses_that_do_not_fit_the_map_are_left_out():
    found = RealScans.of(held_out(0.0, 0.2, 1.5), WALL)
    assert [one.name for one in found.scans] == ["0", "1"]
    assert found.left_out.keys() == {"lost", "2"}
    assert "does not fit the map: half of its points are over 1.50 m away" in found.left_out["2"]
    assert RealScans.of(HeldOut(), WALL) == RealScans()


def test_real_scans_weigh_together_no_more_than_the_simulated_ones():
    assert RealScans.of(held_out(*[0.0] * 5), WALL).weight(120) == MAX_WEIGHT
    many = RealScans.of(held_out(*[0.0] * 100), WALL)
    assert many.weight(40) * 100 == pytest.approx(40)
    assert many.weight(0) == RealScans().weight(0) == 1.0


def test_neighbouring_real_scans_are_on_one_side_of_a_fold():
    scans = RealScans.of(held_out(*[0.0] * 12), WALL)
    queries = [scans.query(number, 153) for number in range(12)]
    assert len(set(queries)) == 12
    assert min(queries) >= 153
    folds = [query % FOLDS for query in queries]
    assert folds == sorted(folds)
    assert set(folds) == set(range(FOLDS))


def test_shares_disagree_only_beyond_chance():
    good, bad = {"1m": 0.95, "localized": 0.9}, {"1m": 0.95, "localized": 0.5}
    assert disagreeing(good, good, (9, 120)) == []
    assert disagreeing(bad, good, (40, 120)) == ["localized"]
    assert disagreeing(bad, good, (4, 120)) == []
    assert disagreeing(bad, good, (0, 120)) == []


@pytest.mark.slow
def test_a_build_asks_the_real_scans_and_leaves_out_bad_ones(small_world: SmallWorld, tmp_path: Path):
    source = tmp_path / "yard"
    held = source / "held_out"
    held.mkdir(parents=True)
    small_world.write(source / "yard.ply")
    config = BuildConfig.parse(COARSE_CONFIG)
    simulator = Simulator(small_world.vertices, small_world.triangles)
    places = np.array([[x, y, 0.8] for x in (-6.0, -2.0, 2.0, 6.0) for y in (-4.0, 0.0, 4.0)])
    gentle = PerturbConfig(occluders=0, strangers=0, unmapped=0, vanished=0)
    rng = np.random.default_rng(8)
    rows = ["scan,tx,ty,tz,qx,qy,qz,qw"]
    for number, (scan, T) in enumerate(
        perturbed_scans(simulator, config.sensor_model, places, 1.0, 8, gentle, rng)
    ):
        np.save(held / f"{number}.npy", scan.points)
        x, y, z = T[:3, 3] + ([0, 0, 5.0] if number == 7 else [0, 0, 0])
        turn = ",".join(map(str, Rotation.from_matrix(T[:3, :3]).as_quat().tolist()))
        rows.append(f"{number}.npy,{x},{y},{z},{turn}")
    np.save(held / "unknown.npy", np.zeros((5, 3), np.float32))
    (held / "poses.csv").write_text("\n".join(rows) + "\n")
    built = build_version(source, config, tmp_path / "work")
    tested = built.manifest.self_test
    real = tested["real"]
    assert tested["queries"] == 4, "simulated scans are counted alone"
    assert real["asked"] == real["of_source"]["asked"] == 7
    assert 3 < real["of_source"]["found"] <= 7
    assert real["weight"] == round(4 / 7, 4)
    assert real["left_out"].keys() == {"7.npy", "unknown.npy"}
    assert "does not fit the map" in real["left_out"]["7.npy"]
    assert real["success"]["1m"] > 0.5, "the map and its sensor are coarse"
    assert real["false_accepts"] == 0
    assert real["held_out"] is None
    names = "asked weight success localized median_error_m false_accepts disagree left_out held_out confirmed"
    assert set(real) == {*names.split(), "of_source"}
    built.manifest.verify_directory(built.directory)


@pytest.mark.slow
def test_a_build_asks_confirmed_queries_and_keeps_no_scan_of_them(
    small_world: SmallWorld, small_map: Path, coarse_work: Path, tmp_path: Path
):
    recorded_queries = RecordedQueries(Store.open("memory://"))
    simulator = Simulator(small_world.vertices, small_world.triangles)
    config = BuildConfig.parse(COARSE_CONFIG)
    places = np.array([[x, y, 0.8] for x in (-6.0, -2.0, 2.0, 6.0) for y in (-4.0, 0.0, 4.0)])
    gentle = PerturbConfig(occluders=0, strangers=0, unmapped=0, vanished=0)
    asked = perturbed_scans(simulator, config.sensor_model, places, 1.0, 4, gentle, np.random.default_rng(8))
    now = datetime.now(timezone.utc)
    ids = []
    for number, (scan, T) in enumerate(asked):
        time, answer = (
            now - timedelta(hours=number),
            {"verdict": "ambiguous", "reasons": [], "probability": 0.4},
        )
        ids.append(record_query(recorded_queries, time, answer, scan.points.tobytes(), map_id="yard"))
        wrong = T if number else make_transform(np.eye(3), [0, 0, 9.0]) @ T
        recorded_queries.set_truth(
            ids[-1], {"map_id": "yard", "T_map_sensor": pose_to_mapping(wrong)}, "key:eve"
        )
    confirmed = collect_confirmed(recorded_queries, "yard", 40, tmp_path / "confirmed")
    built = build_version(small_map, config, coarse_work, confirmed=confirmed)
    real = built.manifest.self_test["real"]
    assert real["asked"] == real["confirmed"]["asked"] == 3
    assert real["of_source"] == {"asked": 0, "found": 0}, "robots bring these"
    assert (real["confirmed"]["robots"], real["confirmed"]["told_by"]) == (1, 1)
    assert real["left_out"].keys() == {ids[0]}
    assert "does not fit the map" in real["left_out"][ids[0]]
    assert real["success"]["1m"] > 0.5, "the map and its sensor are coarse"
    assert not list(coarse_work.rglob("held_out.npz")), "scans of robots stay in no stage"

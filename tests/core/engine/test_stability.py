"""An answer hangs on no hundredth of a millimetre: recorded scans, and the same scans moved by as much."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from firstfix.engine.calibration import Calibration
from firstfix.engine.candidates import Candidates
from firstfix.engine.config import EngineConfig
from firstfix.engine.hypotheses import HypothesisSearch
from firstfix.engine.index import MapIndex
from firstfix.engine.preprocess import preprocess
from firstfix.scan.condense import condense
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import AnyScan, ScanSequence
from firstfix.transform import Matrix, make_transform, pose_error, rotation_z
from tests.reference.recorded_places import RecordedPlace

MOVED_M = 1e-5
MAX_M, MAX_DEG = 0.02, 0.05
SEEDS = 3
FORMS = {"whole": lambda scan: scan, "compact": condense}


def pose_of(place: RecordedPlace, scan: AnyScan, T_map_sensor: Matrix) -> Matrix:
    """The best pose for a scan, from candidates up to half a metre and 3 degrees off the true pose."""
    config = EngineConfig()
    index = MapIndex(config, Calibration(), None, place.surface, place.view)
    prepared = preprocess(ScanSequence.single(scan), None, config.preprocess)
    rng = np.random.default_rng(2)
    off = [
        make_transform(rotation_z(np.radians(rng.uniform(-3, 3))), [*rng.uniform(-0.5, 0.5, 2), 0])
        for _ in range(4)
    ]
    starts = np.array([T_map_sensor @ T for T in off])
    found = HypothesisSearch(index, prepared).run(Candidates(np.arange(4), starts, np.ones(4)))
    return found[0].registration.T_level_sensor


def moved(scan: Scan, seed: int) -> Scan:
    """The scan, all of it moved one way, or each point another way."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(size=3) if seed % 2 else rng.uniform(-1, 1, scan.points.shape)
    return Scan.from_points(scan.points + MOVED_M * steps / np.linalg.norm(steps, axis=-1, keepdims=True))


@pytest.mark.parametrize("form", FORMS)
def test_a_hundredth_of_a_millimetre_moves_no_answer(place: RecordedPlace, form: str):
    for scan, T_map_sensor in place.recorded:
        answer = pose_of(place, FORMS[form](scan), T_map_sensor)
        for seed in range(SEEDS):
            distance_m, angle_deg = pose_error(
                answer, pose_of(place, FORMS[form](moved(scan, seed)), T_map_sensor)
            )
            assert distance_m < MAX_M
            assert angle_deg < MAX_DEG


@pytest.mark.parametrize("form", FORMS)
def test_a_moved_scan_keeps_its_points(place: RecordedPlace, form: str):
    for scan, _ in place.recorded:
        for seed in range(SEEDS):
            one, other = (
                preprocess(ScanSequence.single(FORMS[form](which)), None, EngineConfig().preprocess)
                for which in (scan, moved(scan, seed))
            )
            for mine, its in ((one.dense, other.dense), (one.sparse, other.sparse)):
                distance_m, _ = cKDTree(mine.points).query(its.points)
                assert (distance_m < 10 * MOVED_M).mean() > 0.97

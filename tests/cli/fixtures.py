"""A service in this process that answers scans by their number of points, and commands that ask it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.transform import make_transform, rotation_z
from firstfix_cli.main import run
from tests.fake_service import VERSIONS, FakeService

POSE = make_transform(rotation_z(0.5), [12.0, -4.0, 1.5])
FIT = AlignmentQuality(0.8, 0.7, 0.01)
LOCALIZED, AMBIGUOUS, REJECTED, OFF, FALSE = range(
    100, 105
)  # point counts: how the service tells scans apart


def localized(T: np.ndarray) -> Localization:
    return Localization(
        Verdict.LOCALIZED,
        T_map_sensor=T,
        T_map_base=T,
        covariance=np.eye(6) * 1e-6,
        probability=0.97,
        hypotheses=(Hypothesis(T, AlignmentQuality(0.9, 0.8, 0.01), 0.97, 3),),
        map_id="hall",
        map_version=VERSIONS[0],
        timings_ms={"search": 1.25},
    )


def moved(off_m: float) -> np.ndarray:
    return make_transform(POSE[:3, :3], POSE[:3, 3] + [off_m, 0, 0])


@pytest.fixture
def service() -> Iterator[FakeService]:
    running = FakeService(
        {
            LOCALIZED: localized(moved(0.01)),
            AMBIGUOUS: Localization(
                Verdict.AMBIGUOUS,
                (Reason.SEVERAL_PLACES,),
                hypotheses=(Hypothesis(POSE, FIT, 0.5, 1), Hypothesis(moved(10), FIT, 0.5, 2)),
            ),
            REJECTED: Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,)),
            OFF: localized(moved(0.3)),
            FALSE: localized(moved(30.0)),
        }
    )
    yield running
    running.stop()


@pytest.fixture
def scan(tmp_path):
    def write(count: int) -> Path:
        path = tmp_path / f"{count}.npy"
        np.save(path, np.random.default_rng(count).uniform(-9, 9, (count, 3)))
        return path

    return write


def ended(arguments: list[object]) -> int:
    with pytest.raises(SystemExit) as caught:
        run([str(argument) for argument in arguments])
    return int(caught.value.code or 0)

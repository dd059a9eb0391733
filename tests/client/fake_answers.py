"""Prepared answers for the client's tests."""

from __future__ import annotations

import json

import numpy as np

from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.scan.scan import Scan
from firstfix.transform import make_transform, rotation_z

T_MAP_SENSOR = make_transform(rotation_z(0.5), [1.0, 2.0, 3.0])
LOCALIZED = Localization(
    Verdict.LOCALIZED,
    T_map_sensor=T_MAP_SENSOR,
    covariance=np.eye(6) * 1e-4,
    probability=0.98,
    hypotheses=(Hypothesis(T_MAP_SENSOR, AlignmentQuality(0.9, 0.8, 0.01), 0.98, 7),),
    map_id="hall",
    map_version="ab" * 32,
    timings_ms={"search": 1.5},
)
REJECTED = Localization(Verdict.REJECTED, (Reason.LOW_INLIER_RATIO,), map_id="hall")
SCAN = Scan.from_points(np.random.default_rng(3).uniform(-20, 20, (500, 3)), np.arange(500), 12.5)


def answer_bytes(answer: Localization = LOCALIZED) -> bytes:
    return json.dumps(answer.to_mapping()).encode()


def problem_bytes(code: str, detail: str = "because") -> bytes:
    return json.dumps({"type": "about:blank", "title": code, "detail": detail, "code": code}).encode()

"""Vectors of options, answers, geographic poses and errors."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.answer.hint import Hint
from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.quality import AlignmentQuality
from firstfix.answer.scan_facts import ScanFacts
from firstfix.catalog.geopose import Georeference
from firstfix.findings import scan_kinds
from firstfix.transform import make_transform, rotation_z

Vector = dict[str, Any]

_HERE = make_transform(rotation_z(0.5), [12.31, -4.02, 0.98])
_THERE = make_transform(rotation_z(-3.1), [-80.5, 33.25, 1.02])
_MOUNT = make_transform(rotation_z(np.pi / 2), [0.2, 0.0, 1.1])
_VERSION = "0123456789abcdef" * 4

_ANSWERS = {
    "localized": Localization(
        Verdict.LOCALIZED,
        T_map_sensor=_HERE,
        T_map_base=_HERE @ np.linalg.inv(_MOUNT),
        covariance=np.diag([1e-4, 1e-4, 4e-4, 1e-5, 1e-5, 2.5e-6]),
        probability=0.998,
        hypotheses=(
            Hypothesis(_HERE, AlignmentQuality(0.93, 0.81, 0.004, 0.011), 0.998, 4711),
            Hypothesis(_THERE, AlignmentQuality(0.61, 0.37, 0.09, 0.12), 0.002, 12, "yard"),
        ),
        map_id="hall",
        map_version=_VERSION,
        fix_id="6c1f0e7a9b2d4835",
        timings_ms={"preprocess": 9.1, "describe": 0.4, "search": 2.0, "register": 31.5, "verify": 0.125},
    ),
    "localized-in-motion": Localization(
        Verdict.LOCALIZED,
        T_map_sensor=_HERE,
        twist=np.array([1.2, -0.1, 0.0, 0.0, 0.0, 0.75]),
        probability=0.995,
        hypotheses=(Hypothesis(_HERE, AlignmentQuality(0.93, 0.81, 0.004), 0.995, 4711),),
        map_id="hall",
        map_version=_VERSION,
        map_provisional=True,
    ),
    "localized-degenerate": Localization(
        Verdict.LOCALIZED,
        T_map_sensor=_HERE,
        covariance=np.diag([4.0, 1e-4, 4e-4, 1e-5, 1e-5, 0.0025]),
        degenerate=(
            FreeDirection(Motion.TRANSLATION, np.array([1.0, 0.0, 0.0]), 2.0),
            FreeDirection(Motion.ROTATION, np.array([0.0, 0.0, 1.0]), 0.05),
        ),
        probability=0.996,
        hypotheses=(Hypothesis(_HERE, AlignmentQuality(0.93, 0.81, 0.004), 0.996, 4711),),
        map_id="hall",
        map_version=_VERSION,
    ),
    "ambiguous": Localization(
        Verdict.AMBIGUOUS,
        (Reason.LOW_PROBABILITY, Reason.SEVERAL_PLACES),
        probability=0.51,
        hypotheses=(
            Hypothesis(_HERE, AlignmentQuality(0.93, 0.81, 0.004, 0.011), 0.51, 4711),
            Hypothesis(_THERE, AlignmentQuality(0.92, 0.8, 0.003, 0.0), 0.49, 12),
        ),
        hint=Hint(make_transform(rotation_z(-0.5), [1.6, -1.2, 0.05]), 2.0, -28.5, 0.375, (0, 1)),
        map_id="hall",
        map_version=_VERSION,
    ),
    "candidates": Localization(
        Verdict.AMBIGUOUS,
        (Reason.NOT_REGISTERED,),
        probability=0.75,
        hypotheses=(Hypothesis(_THERE, None, 0.75, 0), Hypothesis(_HERE, None, 0.125, 99)),
        map_id="hall",
        map_version=_VERSION,
    ),
    "rejected": Localization(Verdict.REJECTED, (Reason.TOO_FEW_POINTS,), map_id="hall", map_version=_VERSION),
    "rejected-with-findings": Localization(
        Verdict.REJECTED,
        (Reason.TOO_FEW_POINTS,),
        map_id="hall",
        map_version=_VERSION,
        findings=(
            scan_kinds.UNIT_MILLIMETRES.found({"points": 77093, "in_range": 0, "median_range_m": 8900.0}),
            scan_kinds.SCAN_EMPTY.found(),
        ),
        scan=ScanFacts(77093, 77000, 0, 8900.0, 15000.5, 64, 0.25, 0.1),
    ),
    "wrong-frame": Localization(
        Verdict.REJECTED, (Reason.WRONG_FRAME,), map_version=_VERSION, scan=ScanFacts(12, 0, 0)
    ),
}
_GEOREFERENCE = Georeference.with_heading(47.05, 8.3, 480.0, 30.0)


def documents() -> dict[str, bytes]:
    """Returns the files: documents that a service sends."""
    answers = {name: _rounded(answer.to_mapping()) for name, answer in _ANSWERS.items()}
    localized = json.dumps(answers["localized"])
    problem = {"type": "urn:firstfix:error:not_found", "title": "Not Found", "status": 404}
    degenerate = json.dumps(answers["localized-degenerate"])
    localized_later = {**answers["localized"], "colour": "blue", "hints": [{"a": None}]}
    texts = {
        **{f"answer-{name}": json.dumps(answer) for name, answer in answers.items()},
        "answer-of-a-later-service": json.dumps(localized_later),
        "answer-cut-off": localized[:200],
        "answer-of-no-verdict": localized.replace('"localized"', '"elsewhere"', 1),
        "answer-localized-without-pose": json.dumps({"verdict": "localized", "T_map_sensor": None}),
        "answer-rejected-with-pose": localized.replace('"localized"', '"rejected"', 1),
        "answer-twist-too-short": json.dumps(answers["localized-in-motion"]).replace(
            '"linear": [1.2, ', '"linear": ['
        ),
        "answer-degenerate-of-another-motion": degenerate.replace('"rotation"', '"shear"'),
        "answer-degenerate-without-direction": degenerate.replace('"direction"', '"axis"'),
        "answer-covariance-too-short": localized.replace('"covariance": [0.0001, ', '"covariance": ['),
        "answer-without-quaternion": localized.replace('"quaternion"', '"euler"'),
        "answer-zero-quaternion": json.dumps(
            {"verdict": "localized", "T_map_sensor": {"position": [1, 2, 3], "quaternion": [0, 0, 0, 0]}}
        ),
        "answer-finding-of-words": json.dumps(
            {
                "verdict": "rejected",
                "findings": [{"code": "a", "severity": "error", "text": "b", "numbers": {"far_m": "far"}}],
            }
        ),
        "answer-hint-without-goal": json.dumps({"verdict": "ambiguous", "hint": {"distance_m": 1}}),
        "answer-of-a-list": "[]",
        "answer-of-a-proxy": "<html><body>It works!</body></html>",
        "geopose": json.dumps(_rounded(_GEOREFERENCE.geopose(_HERE))),
        "problem-not-found": json.dumps({**problem, "detail": "no map yard", "code": "not_found"}),
        "problem-without-detail": json.dumps({**problem, "code": "descriptor_mismatch"}),
        "problem-without-code": json.dumps(problem),
        "problem-of-a-proxy": "<html>503 Service Unavailable</html>",
    }
    return {f"documents/{name}.json": text.encode() for name, text in texts.items()}


def vectors() -> Iterator[Vector]:
    """Vectors of ``options``, ``answer``, ``geopose`` and ``problem``."""
    for name, given in {
        "none": {},
        "numbers": {"max_candidates": 20, "min_probability": 0.95, "deadline_ms": 1500.5},
        "false-accepts": {"max_false_accept": 0.01},
        "gravity": {"gravity": [0.1, -0.2, -9.79]},
        "prior": {"prior": [12.5, -3.0, 0.1, 5.0]},
        "prior-with-heading": {"prior": [1e-7, 123456.789, 0.0, 0.30000000000000004, -90.0, 15.0]},
        "mounting": {"T_base_sensor": {"position": [0.2, 0.0, 1.1], "quaternion": [0.0, 0.0, 0.6, 0.8]}},
        "odometry": {"T_odom_base": {"position": [3.5, -0.25, 0.0], "quaternion": [0.0, 0.0, 0.8, 0.6]}},
        "version": {"version": _VERSION},
        "twist": {"twist": [1.5, -0.25, 0.0, 0.0, 0.0, 0.7]},
    }.items():
        yield {"name": f"options-{name}", "function": "options", "input": given}
    for name in (*_ANSWERS, "of-a-later-service"):
        yield _of("answer", f"answer-{name}")
    for name in (
        "cut-off",
        "of-no-verdict",
        "localized-without-pose",
        "rejected-with-pose",
        "covariance-too-short",
        "twist-too-short",
        "degenerate-of-another-motion",
        "degenerate-without-direction",
        "without-quaternion",
        "zero-quaternion",
        "finding-of-words",
        "hint-without-goal",
        "of-a-list",
        "of-a-proxy",
    ):
        yield {**_of("answer", f"answer-{name}"), "expected": {"error": "unreadable"}}
    yield _of("geopose", "geopose")
    for name, status in (
        ("not-found", 404),
        ("without-detail", 409),
        ("without-code", 404),
        ("of-a-proxy", 502),
    ):
        yield _of("problem", f"problem-{name}", status=status)
    yield {**_of("problem", "problem-of-a-proxy", status=503), "name": "problem-of-an-overloaded-proxy"}


def _rounded(data: Any) -> Any:
    """Rounds numbers to twelve decimals, so that the file is the same on every machine."""
    if isinstance(data, dict):
        return {key: _rounded(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_rounded(value) for value in data]
    return round(data, 12) if isinstance(data, float) else data


def _of(function: str, name: str, **more: Any) -> Vector:
    return {"name": name, "function": function, "input": {"document": f"documents/{name}.json", **more}}

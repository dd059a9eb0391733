"""Answers of the program ``firstfix_localize_here``, beside those of the Python localizer."""

from __future__ import annotations

import math
import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.scan.scan import Scan
from firstfix.transform import quaternion_of
from firstfix.wire.scan import encode_scan

PROGRAM = "firstfix_localize_here"
UNEXPLAINED = "explaining=0"  # no other forms of a scan are tried: how many are, its time decides
EXIT_CODES = {"localized": 0, "ambiguous": 3, "rejected": 4}


def lines_of(answer: Localization) -> list[tuple[str, list[str], list[float]]]:
    """An answer as the program writes it: names, words, numbers."""
    lines: list[tuple[str, list[str], list[float]]] = [
        ("verdict", [answer.verdict.value], []),
        ("probability", [], [answer.probability]),
    ]
    named = [answer.map_id] if answer.map_id else []  # of several maps
    lines += [("map", named, [])] if named else []
    lines += [("reason", [reason.value], []) for reason in answer.reasons]
    if answer.T_map_sensor is not None and answer.covariance is not None:
        lines.append(("T_map_sensor", [], pose_of(answer.T_map_sensor)))
        lines.append(("covariance", [], answer.covariance.ravel().tolist()))
    if answer.T_map_base is not None:
        lines.insert(3 + len(named), ("T_map_base", [], pose_of(answer.T_map_base)))
    if answer.twist is not None:
        lines.append(("twist", [], answer.twist.tolist()))
    for free in answer.degenerate:
        lines.append(("free", [free.motion.value], [*free.direction.tolist(), free.sigma]))
    for one in answer.hypotheses:
        fit = one.quality
        assert fit is not None
        shares = [fit.inlier_ratio, fit.alignment_score, fit.free_space_violation, fit.removed_surface]
        shares += [math.nan if fit.seen_free is None else fit.seen_free, float(one.template)]
        of_map = [one.map_id] if one.map_id else []
        lines.append(("hypothesis", of_map, [one.probability, *shares, *pose_of(one.T_map_sensor)]))
    assert answer.scan is not None
    facts = answer.scan.to_mapping().values()
    lines.append(("scan", [], [math.nan if fact is None else float(fact) for fact in facts]))
    return lines


def pose_of(T: np.ndarray) -> list[float]:
    return [*T[:3, 3].tolist(), *quaternion_of(T).tolist()]


def printed(done: subprocess.CompletedProcess[str]) -> list[tuple[str, list[str], list[float]]]:
    """The lines of a program that ended with an answer."""
    assert done.returncode in EXIT_CODES.values(), done.stdout + done.stderr
    lines = []
    for line in done.stdout.splitlines():
        name, *rest = line.split()
        words = [word for word in rest if re.fullmatch("[a-z_]+", word) and word != "nan"]
        lines.append((name, words, [float(word) for word in rest[len(words) :]]))
    assert EXIT_CODES[lines[0][1][0]] == done.returncode
    return lines


def same(found: list[tuple[str, list[str], list[float]]], answer: Localization) -> bool:
    """Whether all names, words and numbers are equal; nan, which is not known, equals nan."""
    wanted = lines_of(answer)
    if [line[:2] for line in found] != [line[:2] for line in wanted]:
        return False
    return all(np.array_equal(a[2], b[2], equal_nan=True) for a, b in zip(found, wanted, strict=True))


def written(scan: Scan, path: Path) -> Path:
    path.write_bytes(encode_scan(scan))
    return path


def upside_down(scan: Scan) -> Scan:
    return Scan(scan.points * np.float32([1, -1, -1]))


def of_one_side(scan: Scan, width_deg: float) -> Scan:
    azimuth = np.degrees(np.arctan2(scan.points[:, 1], scan.points[:, 0]))
    return Scan(scan.points[np.abs(azimuth) < width_deg / 2])


def in_time(scan: Scan) -> Scan:
    azimuth = np.arctan2(scan.points[:, 1], scan.points[:, 0])
    return replace(scan, time_s=(azimuth / (2 * np.pi) * 0.1 - 0.05).astype(np.float32))


def noise(_: Scan) -> Scan:
    points = np.random.default_rng(1).uniform(-8, 8, (5000, 3))
    return Scan(points.astype(np.float32))


def findings_of(answer: Localization) -> str:
    """The findings as the program prints them."""
    return "".join(f"{one.code}: {one.text} {one.remedy}\n" for one in answer.findings)

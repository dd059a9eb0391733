"""Real street and hall, a simulated office: success, error, probability, bytes and time of every form.

    python -m benchmarks.run encodings [--quick] [--json FILE]

Leaves ``report.md`` in ``build/bench/encodings``.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.builds.config import BuildConfig
from firstfix.decode import decode_query, read_scan_file
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.descriptor_parameters import DescriptorParameters
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, pose_error
from firstfix_builder.execution.stage_cache import StageCache
from firstfix_builder.pipeline import build_version
from firstfix_cli.evaluate import Outcome, outcome_of, random_yaws, report_of, turned
from firstfix_cli.poses_csv import read_poses_csv

from ..common.datasets import HALL, STREET, Dataset
from ..common.worlds import WORLDS
from ..robust.cases import CASES, Case
from ..robust.queries import queries_of
from ..robust.versions import Versions
from .forms import DESCRIPTOR, FORMS, QUICK, Form

WORK = Path(__file__).parents[2] / "build" / "bench" / "encodings"
SEED = 6
YAWS = tuple(range(1, 9))  # seeds: every real scan is asked at so many headings
WORLD, WORLD_CASES, WORLD_QUERIES = "office", ("all at once", "mid-360 asks, all at once"), 100
PLACE_M, PLACE_DEG = 2.0, 20.0  # a candidate so near is the right place
Query = tuple[Scan, Matrix | None]


def run(quick: bool) -> dict[str, Any]:
    """The quick suite asks the hall alone, at one heading, in three forms."""
    figures: dict[str, Any] = {"machine": {"cpus": os.cpu_count()}, "seed": SEED}
    for dataset in (HALL,) if quick else (STREET, HALL):
        if not dataset.available:
            figures[dataset.name] = f"skipped: {dataset.folder} is not beside the checkout"
            continue
        localizer, queries = _real(dataset, YAWS[:1] if quick else YAWS)
        figures[dataset.name] = measure(localizer, queries, QUICK if quick else FORMS)
    if not quick:
        for case, localizer, queries in _simulated():
            figures[f"{WORLD}, {case}"] = measure(localizer, queries, FORMS)
    WORK.mkdir(parents=True, exist_ok=True)
    (WORK / "report.md").write_text(report(figures))
    return figures


def measure(localizer: Localizer, queries: Sequence[Query], forms: Sequence[Form]) -> dict[str, Any]:
    """A row of figures a form; the first form is what the others' probabilities are held against."""
    localizer.localize(queries[0][0])  # the first pays for what is loaded late
    rows: dict[str, Any] = {}
    reference: list[Outcome] = []
    for form in forms:
        outcomes, bytes_, encode_ms, decode_ms = _asked(localizer, queries, form)
        reference = reference or outcomes
        rows[form.name] = _figures(outcomes, reference, form) | {
            "bytes": {"p50": int(np.median(bytes_)), "max": max(bytes_)},
            "encode_ms": round(float(np.median(encode_ms)), 2),
            "decode_ms": round(float(np.median(decode_ms)), 2),
        }
        print(form.name, rows[form.name], file=sys.stderr, flush=True)
    return rows


def _asked(
    localizer: Localizer, queries: Sequence[Query], form: Form
) -> tuple[list[Outcome], list[int], list[float], list[float]]:
    """Returns the outcome and the bytes of every query, and the milliseconds of encoding and decoding."""
    known = DescriptorParameters.from_engine(localizer.index.config.model_dump())
    outcomes, bytes_, encode_ms, decode_ms = [], [], [], []
    for number, (scan, T_map_sensor) in enumerate(queries):
        began = time.perf_counter()
        body = b"" if form.encode is None else form.encode(scan, known)
        encode_ms.append(1e3 * (time.perf_counter() - began))
        bytes_.append(12 * len(scan) if form.encode is None else len(body))
        began = time.perf_counter()
        query = scan if form.encode is None else decode_query(body, form.media_type)
        decode_ms.append(1e3 * (time.perf_counter() - began))
        answer = localizer.localize(query)
        ms = 1e3 * (time.perf_counter() - began)
        outcomes.append(outcome_of(str(number), T_map_sensor, answer, ms))
    return outcomes, bytes_, encode_ms, decode_ms


def _figures(outcomes: Sequence[Outcome], reference: Sequence[Outcome], form: Form) -> dict[str, Any]:
    whole = report_of(outcomes)
    kept = ("n", "success_0.2m", "median_error_m", "median_error_deg", "false_accept_rate", "verdicts")
    figures = {name: whole[name] for name in kept} | {"ms": round(whole["ms"]["p50"], 1)}
    inside = [o for o in outcomes if o.T_map_sensor is not None]
    right = [_right_places(o.answer, o.T_map_sensor) for o in inside if o.T_map_sensor is not None]
    figures["first_right"] = round(float(np.mean([any(places[:1]) for places in right])), 4)
    figures["among_10"] = round(float(np.mean([any(places[:10]) for places in right])), 4)
    claimed = [o.answer.probability for o in outcomes]
    figures["claimed"] = round(float(np.mean(claimed)), 4)
    if form is not DESCRIPTOR:
        shift = _log_odds(claimed) - _log_odds([o.answer.probability for o in reference])
        figures["log_odds_shift"] = round(float(np.median(shift)), 3)
        figures["same_verdict"] = round(
            float(
                np.mean([a.is_accepted == b.is_accepted for a, b in zip(outcomes, reference, strict=True)])
            ),
            4,
        )
    return figures


def _right_places(answer: Localization, T_map_sensor: Matrix) -> list[bool]:
    errors = (pose_error(T_map_sensor, h.T_map_sensor) for h in answer.hypotheses)
    return [metres <= PLACE_M and degrees <= PLACE_DEG for metres, degrees in errors]


def _log_odds(probability: Sequence[float]) -> np.ndarray[Any, Any]:
    p = np.clip(probability, 1e-6, 1 - 1e-6)
    return np.log(p / (1 - p))


def _real(dataset: Dataset, yaws: Sequence[int]) -> tuple[Localizer, list[Query]]:
    work = WORK / dataset.name
    work.mkdir(parents=True, exist_ok=True)
    trajectory = dataset.write_trajectory(work / "trajectory.csv")
    built = build_version(dataset.map_path, BuildConfig.parse(dataset.config), work, trajectory=trajectory)
    rows = read_poses_csv(dataset.write_queries(work / "poses.csv"))
    queries = [
        turned(read_scan_file(row.path), row.T_map_sensor, float(yaw))
        for seed in yaws
        for row, yaw in zip(rows, random_yaws(len(rows), seed), strict=True)
    ]
    return Localizer(MapIndex.load(built.directory)), queries


def _simulated() -> Iterator[tuple[str, Localizer, list[Query]]]:
    world = next(world for world in WORLDS if world.name == WORLD)
    files = world.make(StageCache(WORK))
    versions = Versions(world, files, WORK / world.name)
    for number, name in enumerate(WORLD_CASES):
        case: Case = next(case for case in CASES if case.name == name)
        localizer, rng = versions.localizer(case.templates), np.random.default_rng([SEED, number])
        sensor = versions.sensor(case.queries)
        yield name, localizer, queries_of(case, localizer.index, sensor, files, (), WORLD_QUERIES, rng)


def report(figures: dict[str, Any]) -> str:
    """A Markdown table a place."""
    head = "| sent as | bytes p50 / max | encode, decode ms | n | 0.2 m | loc / amb / rej | median error "
    head += "| log odds shift | place first / in 10 | ms |"
    parts = []
    for name, rows in figures.items():
        if not isinstance(rows, dict) or name == "machine":
            continue
        lines = [f"### {name}", "", head, "|" + "---|" * 10]
        for form, row in rows.items():
            verdicts = " / ".join(str(row["verdicts"][v]) for v in ("localized", "ambiguous", "rejected"))
            error = (
                ""
                if row["median_error_m"] is None
                else (f"{100 * row['median_error_m']:.1f} cm, {row['median_error_deg']:.2f} deg")
            )
            coding_ms = f"{row['encode_ms']}, {row['decode_ms']}"
            cells = [
                form, f"{row['bytes']['p50']} / {row['bytes']['max']}", coding_ms, row["n"],
                f"{row['success_0.2m']:.2f}", verdicts, error, row.get("log_odds_shift", ""),
                f"{row['first_right']:.2f} / {row['among_10']:.2f}", row["ms"],
            ]  # fmt: skip
            lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
        parts.append("\n".join(lines) + "\n")
    return "\n".join(parts)

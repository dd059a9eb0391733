"""The query flow: one scan in, one answer out. Every stage is one named call."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .covariance import pose_covariance
from .localization import Localization, Reason, Verdict
from .map_index import MapIndex
from .occupancy import best_shifts, occupancy, ring_spectrum
from .options import LocalizeOptions
from .preprocess import PreparedScan, preprocess
from .registration import Registration
from .scan import Scan
from .stopwatch import Stopwatch
from .transform import Matrix, inverse, make_transform, rotation_z
from .verdict import judge, same_place

PLACES = 3  # that get the fine registration: the best, and rivals for the margin
COMPARED_ITERATIONS = 6  # are enough to compare places
PROMISING = 0.02  # probability before the last refinement, which adds a little overlap
CONFIRMATIONS = 2  # candidates that settled at one spot: a further start beside it tells nothing new
BESIDE_M = 2.0


@dataclass(frozen=True)
class Candidate:
    """A template that the search proposes, with the pose it implies."""

    template: int
    T_level_sensor: Matrix
    score: float


class Localizer:
    """Answers queries against one version. Thread-safe."""

    def __init__(self, index: MapIndex) -> None:
        self.index = index

    def localize(self, scan: Scan, options: LocalizeOptions | None = None) -> Localization:
        """The pose of a scan in the map, with no prior, or why there is none."""
        options = options or LocalizeOptions()
        watch = Stopwatch()
        with watch.stage("preprocess"):
            prepared = preprocess(scan, options.gravity, self.index.config.preprocess)
        if prepared is None:
            return Localization(Verdict.REJECTED, (Reason.TOO_FEW_POINTS,), timings_ms=watch.ms)
        with watch.stage("describe"):
            described = self._describe(prepared)
        with watch.stage("search"):
            candidates = self._search(described, prepared, options)
        with watch.stage("register"):
            registered = self._register(prepared, candidates)
        with watch.stage("verify"):
            answer = self._verify(registered, prepared, options)
        return replace(answer, timings_ms=watch.ms)

    def _describe(self, prepared: PreparedScan) -> NDArray[np.bool_]:
        """(rows, sectors) layered occupancy of the levelled scan."""
        points = prepared.points
        height = np.array([prepared.height_m], np.float32)
        of_scan = np.zeros(len(points), np.intp)
        filled = occupancy(points, of_scan, 1, height, self.index.config.descriptor.layered)
        return filled.reshape(filled.shape[1:])

    def _search(
        self, described: NDArray[np.bool_], prepared: PreparedScan, options: LocalizeOptions
    ) -> list[Candidate]:
        """Nearest by key, re-ranked by the best turn of the full descriptor, best first."""
        config, templates = self.index.config, self.index.templates
        key = ring_spectrum(described[None], config.descriptor.coefficients)[0]
        rows = np.sort(self.index.keys.search(key, config.search.by_key))
        layers = templates.layers(rows, config.descriptor.layered)
        shift, score = best_shifts(described, layers)
        count = options.max_candidates or config.search.candidates
        order = np.argsort(-score, kind="stable")[:count]
        turns = shift[order] * (2 * np.pi / config.descriptor.sectors)
        return [
            Candidate(
                int(row),
                make_transform(
                    rotation_z(turn) @ prepared.R_level_sensor,
                    templates.position_m[row] + [0, 0, prepared.height_m - templates.height_m[row]],
                ),
                float(s),
            )
            for row, turn, s in zip(rows[order], turns, score[order], strict=True)
        ]

    def _register(
        self, prepared: PreparedScan, candidates: list[Candidate]
    ) -> list[tuple[int, Registration]]:
        """Distinct places where the candidates settle, best first; only the best gets all the points."""
        cloud = self.index.cloud
        settled: list[tuple[int, Registration]] = []
        for candidate in candidates:
            if not _settled_around(candidate.T_level_sensor, settled):
                settled.append((candidate.template, cloud.settle(prepared.sparse, candidate.T_level_sensor)))
        settled.sort(key=lambda entry: -entry[1].closeness)
        places = [
            (template, cloud.refine(prepared.sparse, place.T_level_sensor, COMPARED_ITERATIONS))
            for template, place in _distinct(settled)[:PLACES]
        ]
        places = _distinct(sorted(places, key=lambda entry: -entry[1].closeness))
        if places and self._promising([place.overlap for _, place in places]):
            template, best = places[0]
            places[0] = (template, cloud.refine(prepared.cloud, best.T_level_sensor))
        return places

    def _promising(self, overlaps: list[float]) -> bool:
        """Whether the best place may yet be accepted: all the points of a scan cost a tenth of a second."""
        margin = overlaps[0] - max(overlaps[1:], default=0.0)
        return self.index.calibration.probability(overlaps[0], margin) >= PROMISING

    def _verify(
        self, registered: list[tuple[int, Registration]], prepared: PreparedScan, options: LocalizeOptions
    ) -> Localization:
        judged = judge(registered, self.index.T_map_level, self.index.calibration, options.min_probability)
        probability = judged.hypotheses[0].probability if judged.hypotheses else 0.0
        answer = Localization(
            Verdict.REJECTED, judged.reasons, None, None, None, probability, judged.hypotheses
        )
        if judged.verdict is not Verdict.LOCALIZED:
            return replace(answer, verdict=judged.verdict)
        T_map_sensor = judged.hypotheses[0].T_map_sensor
        mounting = options.T_base_sensor
        return replace(
            answer,
            verdict=Verdict.LOCALIZED,
            T_map_sensor=T_map_sensor,
            T_map_base=None if mounting is None else T_map_sensor @ inverse(mounting),
            covariance=pose_covariance(
                registered[0][1].information, T_map_sensor, self.index.config.registration
            ),
        )


def _settled_around(T_level_sensor: Matrix, settled: list[tuple[int, Registration]]) -> bool:
    """Whether enough candidates have settled well at one place near this start."""
    near = [
        known.T_level_sensor
        for _, known in settled
        if np.linalg.norm(known.T_level_sensor[:3, 3] - T_level_sensor[:3, 3]) < BESIDE_M
    ]
    return any(sum(same_place(a, b) for b in near) > CONFIRMATIONS for a in near)


def _distinct(entries: list[tuple[int, Registration]]) -> list[tuple[int, Registration]]:
    """The first of every place, in order."""
    kept: list[tuple[int, Registration]] = []
    for entry in entries:
        if not any(same_place(entry[1].T_level_sensor, known.T_level_sensor) for _, known in kept):
            kept.append(entry)
    return kept

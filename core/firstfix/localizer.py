"""The query flow: one scan in, one answer out. Every stage is one named call."""

from __future__ import annotations

from dataclasses import replace

from .candidates import search
from .covariance import pose_covariance
from .localization import Localization, Reason, Verdict
from .map_index import MapIndex
from .options import LocalizeOptions
from .places import Place, find_places
from .preprocess import preprocess
from .scan import Scan
from .scan_sequence import ScanSequence
from .stopwatch import Stopwatch
from .transform import inverse
from .verdict import judge


class Localizer:
    """Answers queries against one version. Thread-safe."""

    def __init__(self, index: MapIndex) -> None:
        self.index = index

    def localize(self, scan: Scan | ScanSequence, options: LocalizeOptions | None = None) -> Localization:
        """The pose in the map where a scan, or the last of several, was taken; or why there is none."""
        sequence = ScanSequence.single(scan) if isinstance(scan, Scan) else scan
        options, index, watch = options or LocalizeOptions(), self.index, Stopwatch()
        with watch.stage("preprocess"):
            prepared = preprocess(sequence, options.gravity, index.config.preprocess)
        if prepared is None:
            return Localization(Verdict.REJECTED, (Reason.TOO_FEW_POINTS,), timings_ms=watch.ms)
        with watch.stage("describe"):
            described = [index.cascade.descriptor.describe(one.batch) for one in prepared.scans]
        with watch.stage("search"):
            candidates = search(index, described, prepared, options)
        with watch.stage("register"):
            places = find_places(index, prepared, candidates, options.prior)
        with watch.stage("verify"):
            answer = self._verify(places, options)
        return replace(answer, timings_ms=watch.ms)

    def _verify(self, places: list[Place], options: LocalizeOptions) -> Localization:
        """The verdict on the places, and the pose where there is one."""
        judged = judge(places, self.index.T_map_level, self.index.calibration, options.min_probability)
        if judged.verdict is not Verdict.LOCALIZED:
            return Localization(
                judged.verdict, judged.reasons, probability=judged.probability, hypotheses=judged.hypotheses
            )
        T_map_sensor, mounting = judged.hypotheses[0].T_map_sensor, options.T_base_sensor
        return Localization(
            Verdict.LOCALIZED,
            T_map_sensor=T_map_sensor,
            T_map_base=None if mounting is None else T_map_sensor @ inverse(mounting),
            covariance=pose_covariance(
                places[0].registration.information, T_map_sensor, self.index.config.registration
            ),
            probability=judged.probability,
            hypotheses=judged.hypotheses,
        )

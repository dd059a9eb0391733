"""firstfix itself, in process: its answer is accepted when it says ``localized``."""

from __future__ import annotations

from pathlib import Path

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan

from .answer import Answer
from .peer_input import PeerInput
from .prior import Prior
from .sent import encoded_bytes


class Ours:
    sent_bytes = staticmethod(encoded_bytes)

    def __init__(self, given: PeerInput) -> None:
        self._localizer = Localizer(MapIndex.load(self._version(given)))

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        return self._answer(scan, LocalizeOptions())

    def _version(self, given: PeerInput) -> Path:
        return given.version

    def _answer(self, scan: Scan, options: LocalizeOptions) -> Answer:
        found = self._localizer.localize(scan, options)
        if not found.hypotheses:
            return Answer()
        return Answer(found.hypotheses[0].T_map_sensor, found.probability, found.T_map_sensor is not None)


class OursWithGravity(Ours):
    """With the direction of gravity, as 3D-BBS has it."""

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        return self._answer(scan, LocalizeOptions(gravity=prior.gravity))


class PaperMethod(Ours):
    """The method of the paper that firstfix began with: one word of the build's config."""

    def _version(self, given: PeerInput) -> Path:
        return given.paper_version

"""firstfix itself, in process: an answer counts only when it says ``localized``."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.options import LocalizeOptions
from firstfix.engine.index import MapIndex
from firstfix.engine.localizer import Localizer
from firstfix.scan.scan import Scan
from firstfix.transform import Matrix

from .peer_input import PeerInput


class Ours:
    def __init__(self, given: PeerInput) -> None:
        self._localizer = Localizer(MapIndex.load(given.version))

    def __call__(self, scan: Scan, gravity: NDArray[np.float64]) -> Matrix | None:
        return self._localizer.localize(scan).T_map_sensor


class OursWithGravity(Ours):
    """With the direction of gravity, as 3D-BBS has it."""

    def __call__(self, scan: Scan, gravity: NDArray[np.float64]) -> Matrix | None:
        return self._localizer.localize(scan, LocalizeOptions(gravity=gravity)).T_map_sensor

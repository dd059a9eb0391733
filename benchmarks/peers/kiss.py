"""KISS-Matcher (Lim et al. 2025, its own C++), then ICP. It takes the map anew with every scan.

Its confidence is the number of final inliers. As in its own example, fewer than five are not accepted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.scan import Scan
from firstfix.transform import make_transform

from .answer import Answer
from .icp import Icp
from .peer_input import PeerInput
from .sent import points_bytes

LEAST_INLIERS = 5


class Kiss:
    sent_bytes = staticmethod(points_bytes)

    def __init__(self, given: PeerInput) -> None:
        points = given.map_points()
        self._given, self._map = given, points.astype(np.float32)
        self._icp = Icp(points, 1.5 * given.kiss_voxel_m)

    def __call__(self, scan: Scan, gravity: NDArray[np.float64]) -> Answer:
        import kiss_matcher  # not among the project's needs

        points = self._given.cropped(scan)
        matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(self._given.kiss_voxel_m))
        found = matcher.estimate(points.astype(np.float32), self._map)
        inliers = matcher.get_num_final_inliers()
        coarse = make_transform(found.rotation, np.ravel(found.translation))
        if not np.isfinite(coarse).all():
            return Answer()
        return Answer(self._icp.refine(points, coarse), float(inliers), inliers >= LEAST_INLIERS)

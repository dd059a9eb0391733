"""KISS-Matcher (Lim et al. 2025, its own C++), then ICP. It takes the map anew with every scan.

As in its own example, a match of fewer than five inliers is no answer.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.scan import Scan
from firstfix.transform import Matrix, make_transform

from .icp import Icp
from .peer_input import PeerInput

LEAST_INLIERS = 5


class Kiss:
    def __init__(self, given: PeerInput) -> None:
        points = given.map_points()
        self._given, self._map = given, points.astype(np.float32)
        self._icp = Icp(points, 1.5 * given.kiss_voxel_m)

    def __call__(self, scan: Scan, gravity: NDArray[np.float64]) -> Matrix | None:
        import kiss_matcher  # not among the project's needs

        points = self._given.cropped(scan)
        matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(self._given.kiss_voxel_m))
        found = matcher.estimate(points.astype(np.float32), self._map)
        if matcher.get_num_final_inliers() < LEAST_INLIERS:
            return None
        return self._icp.refine(points, make_transform(found.rotation, np.ravel(found.translation)))

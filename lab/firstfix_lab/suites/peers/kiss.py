"""KISS-Matcher (Lim et al. 2025, its own C++), then ICP. It takes the map anew with every scan.

Its config is its default (scan to scan) but for the voxels: 1 m and 0.5 m are what its author and its users
take for maps of streets and of rooms (MIT-SPARK/KISS-Matcher, issues 18 and 50). Its author says that a scan
and a map need to overlap in volume (issue 18): so it is asked once with the whole map, and once with what
lies round a coarse position, which no other peer is given. There the voxels are 0.5 m everywhere: on the
street it finds some scans with these, and none with 1 m. Its confidence is the number of final inliers. As in
its own example, fewer than five are not accepted.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from firstfix.scan.scan import Scan
from firstfix.transform import make_transform

from .answer import Answer
from .icp import Icp
from .peer_input import PeerInput
from .prior import POSITION_OFF_M, Prior
from .sent import points_bytes

MIN_INLIERS = 5
CROPPED_VOXEL_M = 0.5
REACH_PERCENT = 90  # of a scan's points lie within its reach


class Kiss:
    sent_bytes = staticmethod(points_bytes)

    def __init__(self, given: PeerInput) -> None:
        points = given.map_points()
        self._given, self._map = given, points.astype(np.float32)
        self._voxel_m = given.kiss_voxel_m
        self._icp = Icp(points, 1.5 * given.kiss_voxel_m)

    def __call__(self, scan: Scan, prior: Prior) -> Answer:
        import kiss_matcher  # not among the project's needs

        points = self._given.cropped(scan)
        matcher = kiss_matcher.KISSMatcher(kiss_matcher.KISSMatcherConfig(self._voxel_m))
        found = matcher.estimate(points.astype(np.float32), self._searched(points, prior))
        inliers = matcher.get_num_final_inliers()
        coarse = make_transform(found.rotation, np.ravel(found.translation))
        if not np.isfinite(coarse).all():
            return Answer()
        return Answer(self._icp.refine(points, coarse), float(inliers), inliers >= MIN_INLIERS)

    def _searched(self, points: NDArray[np.float64], prior: Prior) -> NDArray[np.float32]:
        return self._map


class KissCropped(Kiss):
    """With the part of the map that the scan reaches from anywhere near the coarse position."""

    def __init__(self, given: PeerInput) -> None:
        super().__init__(given)
        self._voxel_m = CROPPED_VOXEL_M

    def _searched(self, points: NDArray[np.float64], prior: Prior) -> NDArray[np.float32]:
        reach_m = np.percentile(np.linalg.norm(points, axis=1), REACH_PERCENT)
        away_m = np.linalg.norm(self._map[:, :2] - prior.position, axis=1)
        return self._map[away_m < reach_m + POSITION_OFF_M]

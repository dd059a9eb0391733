"""One check of a robot's own localization: asks about its pose first, then anywhere, and compares.

Once a minute a robot with odometry asks anywhere first. Such fixes confirm each other, if the service keeps
the queries.
"""

from __future__ import annotations

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.answer.prior import Prior
from firstfix.transform import Matrix, inverse

from .answerer import Answerer
from .config import GatewayConfig
from .query import Fix, Query
from .senses import Senses
from .watch import Comparison, Watch, is_near

ANYWHERE_S = 60.0  # at most so often a check asks anywhere first: a prior would hide a wrong place
NEARLY = 0.9  # a pose with this share of the best alignment score explains the scan, too


class Checker:
    """Checks with one robot's senses.

    Args:
        watch: takes what was seen.
    """

    def __init__(self, ask: Answerer, senses: Senses, config: GatewayConfig, watch: Watch) -> None:
        self._ask, self._senses, self._config, self._watch = ask, senses, config, watch
        self._anywhere_ns: int | None = None  # stamp of the last check that asked anywhere first

    def check(self, query: Query, last_fix: Fix | None) -> tuple[Localization, Fix | None]:
        """Asks, and lets the watch see the fix.

        Args:
            last_fix: carried on by odometry, it is the prior where the robot's own pose is not known.

        Raises:
            FirstfixError, ConnectionError: no answer.
        """
        prior = self._prior(query, last_fix)
        priors = [None] if prior is None else [prior, None]
        if self._asks_anywhere_first(query):
            priors.reverse()
        answers: list[Localization] = []
        fix = None
        while priors and fix is None:
            answers.append(query.ask(self._ask, priors.pop(0)))
            fix = query.fix(answers[-1])
        # Only now: a localization that works with the same cloud gives its pose after it.
        own = self._senses.own_localization(query.frame, query.header.stamp)
        if own is None:
            self._watch.reset()
        elif fix is not None:
            poses = _poses_that_fit(answers, query.T_frame_sensor)
            explains = any(is_near(own.T_map_frame, T, self._config, planar=own.planar) for T in poses)
            self._watch.see(
                Comparison(
                    fix.T_map_frame, fix.covariance, own.T_map_frame, fix.T_odom_frame, own.planar, explains
                )
            )
        return answers[-1], fix

    def _asks_anywhere_first(self, query: Query) -> bool:
        now_ns = query.header.stamp.ns
        if self._anywhere_ns is None or now_ns < self._anywhere_ns:  # the first check, or a new clock
            self._anywhere_ns = now_ns
        if not query.has_odometry or now_ns - self._anywhere_ns < ANYWHERE_S * 1e9:
            return False
        self._anywhere_ns = now_ns
        return True

    def _prior(self, query: Query, last_fix: Fix | None) -> Prior | None:
        expected = self._expected(query, last_fix)
        if expected is None:
            return None
        T = expected if query.T_frame_sensor is None else expected @ query.T_frame_sensor
        return Prior(T[:3, 3].copy(), self._config.prior_radius_m)

    def _expected(self, query: Query, last_fix: Fix | None) -> Matrix | None:
        """The pose (4, 4) of the query's frame as it is known without a fix."""
        by_odometry = None
        if last_fix is not None and last_fix.frame == query.frame and last_fix.T_odom_frame is not None:
            T_odom_frame = self._senses.odometry(query.frame, query.header.stamp)
            if T_odom_frame is not None:
                by_odometry = last_fix.T_map_frame @ inverse(last_fix.T_odom_frame) @ T_odom_frame
        own = self._senses.own_localization(query.frame, query.header.stamp)
        if own is None:
            return by_odometry
        expected = own.T_map_frame.copy()
        if own.planar and by_odometry is not None:
            expected[2, 3] = by_odometry[2, 3]
        return expected


def _poses_that_fit(answers: list[Localization], T_frame_sensor: Matrix | None) -> list[Matrix]:
    """The poses of the frame that fit the scan nearly as well as the best one."""
    scored = [
        (h.quality.alignment_score, h.T_map_sensor)
        for answer in answers
        for h in answer.hypotheses
        if h.quality is not None
    ]
    best = max((score for score, _ in scored), default=0.0)
    T_sensor_frame = np.eye(4) if T_frame_sensor is None else inverse(T_frame_sensor)
    return [T @ T_sensor_frame for score, T in scored if score >= NEARLY * best]

"""Outcome of one query of the self-test: its answer compared with the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.answer.quality import AlignmentQuality, MatchFeatures
from firstfix.engine.calibration import Calibration
from firstfix.transform import Matrix, pose_error

RIGHT_M, RIGHT_DEG = 1.0, 10.0  # a fix with a larger error is a false accept
ABSENT_BEYOND_M = 3.0  # nearer places are missing, too, if the true place is missing from the map
_UNFITTED = Calibration()  # decides which places tie, which does not depend on the fit


@dataclass(frozen=True)
class Outcome:
    """One query and its answer.

    Attributes:
        query: number of the query; a scan and its mirror image have the same number.
        T_level_sensor: (4, 4) true pose of the scan; None: it is of no place in the map.
        errors_m: of the hypotheses in their order; infinite if the rotation is off by over RIGHT_DEG.
        is_mirrored: whether the scan is the mirror image of one taken in the map.
    """

    query: int
    answer: Localization
    T_level_sensor: Matrix | None
    errors_m: tuple[float, ...]
    is_mirrored: bool = False

    @classmethod
    def here(cls, query: int, answer: Localization, T_level_sensor: Matrix, T_map_level: Matrix) -> Outcome:
        """The outcome of a scan taken in the map."""
        T_map_sensor = T_map_level @ T_level_sensor
        errors = [pose_error(T_map_sensor, one.T_map_sensor) for one in answer.hypotheses]
        errors_m = tuple(error_m if error_deg <= RIGHT_DEG else np.inf for error_m, error_deg in errors)
        return cls(query, answer, T_level_sensor, errors_m)

    @classmethod
    def nowhere(cls, query: int, answer: Localization, is_mirrored: bool = False) -> Outcome:
        """The outcome of a scan whose place is not in the map."""
        return cls(query, answer, None, (np.inf,) * len(answer.hypotheses), is_mirrored)

    @property
    def first_error_m(self) -> float:
        """Error of the best hypothesis, infinite if there is none."""
        return self.errors_m[0] if self.errors_m else np.inf

    @property
    def least_error_m(self) -> float:
        """Least error of all hypotheses, infinite if there are none."""
        return min(self.errors_m, default=np.inf)

    @property
    def right(self) -> bool:
        """Returns whether the best hypothesis is right."""
        return self.first_error_m <= RIGHT_M

    @property
    def features(self) -> MatchFeatures | None:
        """Match features of the best hypothesis, None if there is none."""
        return _UNFITTED.match_features(self._fits) if self._fits else None

    @property
    def right_among_tied(self) -> bool:
        """Returns whether the best hypothesis is right, or one that ties with it."""
        found = self.features
        return found is not None and min(self.errors_m[: found.tied]) <= RIGHT_M

    def accepted_by(self, calibration: Calibration) -> bool:
        """Returns whether the calibrated localizer would call this localized."""
        found = self.features
        return found is not None and calibration.accepts(found)

    @property
    def without_the_truth(self) -> MatchFeatures | None:
        """A hard negative: the match features of the answer without the true place and its equals.

        Look-alikes in the same map are better training data than scans of a strange place: the next aisle of
        a hall explains four fifths of a scan. Places equal to the true one are no negatives, because nothing
        shows that they are wrong.
        """
        found = self.features
        if found is None or not self.right_among_tied:
            return None
        tied, others = self.answer.hypotheses[: found.tied], self.answer.hypotheses[found.tied :]
        elsewhere = [
            other.quality
            for other in others
            if other.quality is not None
            and all(pose_error(one.T_map_sensor, other.T_map_sensor)[0] > ABSENT_BEYOND_M for one in tied)
        ]
        # a single place has no margin
        return _UNFITTED.match_features(elsewhere) if len(elsewhere) > 1 else None

    @property
    def _fits(self) -> list[AlignmentQuality]:
        return [h.quality for h in self.answer.hypotheses if h.quality is not None]

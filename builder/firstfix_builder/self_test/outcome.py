"""One query of the self-test, and its answer judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from firstfix.answer.localization import Localization
from firstfix.answer.quality import AlignmentQuality
from firstfix.engine.calibration import Calibration
from firstfix.engine.ranking import RANKING, MatchFeatures, RankingConfig
from firstfix.transform import Matrix, pose_error

from .equal_places import NO_EQUALS, EqualPlaces

RIGHT_M, RIGHT_DEG = 1.0, 10.0  # further off than this, a fix is a false one
ABSENT_BEYOND_M = 3.0  # from the true place: what is nearer would not be in the map without it either


@dataclass(frozen=True)
class Outcome:
    """One query and its answer.

    Attributes:
        query: number.
        T_level_sensor: (4, 4) where the scan was taken, or None: at no place of the map.
        errors_m: of each hypothesis in turn; infinite where it is turned by over RIGHT_DEG too.
        is_real: whether the scan is a real one.
        is_rough: whether it is a simulated one that was disturbed more than real ones are.
        equals: those of the true place among the hypotheses.
        min_margin: of this map: places whose support differs by less tie.
        aliases: numbers of the hypotheses that are known aliases of the best one.
        lead_lost: see ``alias_leads.lead_lost``.
        ranking: the numbers of this map.
    """

    query: int
    answer: Localization
    T_level_sensor: Matrix | None
    errors_m: tuple[float, ...]
    is_real: bool = False
    is_rough: bool = False
    equals: EqualPlaces = NO_EQUALS
    min_margin: float = Calibration().min_margin
    aliases: tuple[int, ...] = ()
    lead_lost: float | None = None
    ranking: RankingConfig = RANKING

    @classmethod
    def here(cls, query: int, answer: Localization, T_level_sensor: Matrix, T_map_level: Matrix) -> Outcome:
        """The outcome of a scan taken in the map."""
        T_map_sensor = T_map_level @ T_level_sensor
        errors = [pose_error(T_map_sensor, one.T_map_sensor) for one in answer.hypotheses]
        errors_m = tuple(error_m if error_deg <= RIGHT_DEG else np.inf for error_m, error_deg in errors)
        return cls(query, answer, T_level_sensor, errors_m)

    @classmethod
    def nowhere(cls, query: int, answer: Localization) -> Outcome:
        """The outcome of a scan whose place is not in the map."""
        return cls(query, answer, None, (np.inf,) * len(answer.hypotheses))

    @property
    def is_in_map(self) -> bool:
        """Whether the scan was taken in the map."""
        return self.T_level_sensor is not None

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
        """Whether the best hypothesis is right."""
        return self.first_error_m <= RIGHT_M

    @property
    def evidence(self) -> MatchFeatures | None:
        """Match features of the best hypothesis, None if there is none.

        Known aliases do not tie here: what is close to them teaches most about probability and threshold.
        """
        return self.ranking.match_features(self._fits, self.min_margin) if self._fits else None

    @property
    def right_among_tied(self) -> bool:
        """Whether the best hypothesis is right, or one that ties with it."""
        found = self.evidence
        return found is not None and min(self.errors_m[: found.tied]) <= RIGHT_M

    def accepted_by(self, calibration: Calibration) -> bool:
        """Whether the calibrated localizer would call this localized."""
        found = self._judged_by(calibration)
        return found is not None and calibration.accepts(found)

    def found_by(self, calibration: Calibration) -> bool:
        """Whether the right place is the best one, or ties with it for the verdict."""
        found = self._judged_by(calibration)
        return found is not None and min(self.errors_m[: found.tied]) <= RIGHT_M

    def _judged_by(self, calibration: Calibration) -> MatchFeatures | None:
        """Match features of the best hypothesis for the verdict: its known aliases tie, too."""
        if not self._fits:
            return None
        return self.ranking.match_features(
            self._fits,
            self.min_margin,
            aliases=self.aliases,
            aliases_tied_within=calibration.alias_margin,
        )

    @property
    def without_the_truth(self) -> MatchFeatures | None:
        """A hard negative: the evidence if neither the true place nor its equals were in the map.

        A map's own look-alikes teach more than scans of a strange place: the next aisle of a hall explains
        four fifths of a scan. An equal of the true place teaches nothing: nobody could tell that it is wrong.
        """
        found = self.evidence
        if found is None or not self.right_among_tied:
            return None
        tied = self.answer.hypotheses[: found.tied]
        elsewhere = [
            other.quality
            for number, other in enumerate(self.answer.hypotheses)
            if number >= found.tied
            and number not in self.equals.numbers
            and other.quality is not None
            and all(pose_error(one.T_map_sensor, other.T_map_sensor)[0] > ABSENT_BEYOND_M for one in tied)
        ]
        # of one alone the margin is not known
        return self.ranking.match_features(elsewhere, self.min_margin) if len(elsewhere) > 1 else None

    @property
    def _fits(self) -> list[AlignmentQuality]:
        return [h.quality for h in self.answer.hypotheses if h.quality is not None]

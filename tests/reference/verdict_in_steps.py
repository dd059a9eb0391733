"""The verdict of registered places, kernel by kernel: ``native.answered`` is held against it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firstfix import native
from firstfix.answer.free_direction import FreeDirection, Motion
from firstfix.answer.localization import Hypothesis, Localization, Reason, Verdict
from firstfix.answer.options import LocalizeOptions
from firstfix.engine.config import RegistrationConfig
from firstfix.engine.registered_candidate import RegisteredCandidate
from firstfix.engine.registration.align import MapSurface, Registration
from firstfix.engine.registration.surface import Surface
from firstfix.engine.verdict import threshold_of
from firstfix.transform import Matrix, inverse


def judge(
    ranked: Sequence[RegisteredCandidate], options: LocalizeOptions, scan: Surface | None = None
) -> Localization:
    """Answer of one map or several, each candidate judged by the calibration of its own map.

    Args:
        ranked: distinct, best first.
        scan: many points of the query, as the best one was aligned; None: its information is that of its
            covariance.
    """
    if not ranked:
        return Localization(Verdict.REJECTED, (Reason.NO_CANDIDATE,))
    best, mounting = ranked[0], options.T_base_sensor
    code, probability, shares = _decided(ranked, threshold_of(best.index, options))
    hypotheses = tuple(
        Hypothesis(candidate.T_map_sensor, candidate.quality, share, candidate.template, candidate.map_id)
        for candidate, share in zip(ranked, shares, strict=True)
    )
    if code is not None:
        reason = Reason(code)
        verdict = Verdict.AMBIGUOUS if reason is Reason.SEVERAL_PLACES else Verdict.REJECTED
        return Localization(verdict, (reason,), probability=probability, hypotheses=hypotheses)
    registration, T_map_level = best.registration, best.index.T_map_level
    information = (
        registration.information
        if scan is None
        else faced_information(best.index.surface, scan, registration)
    )
    covariance = pose_covariance(information, T_map_level, best.index.config.registration)
    return Localization(
        Verdict.LOCALIZED,
        T_map_sensor=best.T_map_sensor,
        T_map_base=None if mounting is None else native.pose_product(best.T_map_sensor, inverse(mounting)),
        covariance=covariance,
        probability=probability,
        hypotheses=hypotheses,
        map_id=best.map_id,
        twist=best.registration.twist if options.twist is None else options.twist,
        degenerate=free_directions(covariance),
    )


def _decided(
    ranked: Sequence[RegisteredCandidate], threshold: float | None
) -> tuple[str | None, float, list[float]]:
    """Code of the reason why the best one is not the answer, its probability, and the share of each.

    Args:
        threshold: that the caller asks for; None: the map's own.
    """
    maps = {one.map_id: (one.index.config.ranking, one.index.calibration) for one in ranked}
    number = {map_id: n for n, map_id in enumerate(maps)}
    asked = [
        (
            number[one.map_id],
            one.quality,
            one.support,
            one.spots,
            one.is_alike,
            one.outside_lead,
            one.registration.rests,
            one.registration.is_in_motion,
        )
        for one in ranked
    ]
    return native.decided(list(maps.values()), asked, threshold)


def faced_information(surface: MapSurface, scan: Surface, registration: Registration) -> NDArray[np.float64]:
    """Information (6, 6) of an aligned pose that comes from surfaces which face what they tell of.

    Args:
        scan: as it was aligned, not deskewed.
    """
    still, reach_m = scan.deskewed(registration.twist), surface.config.fine_distance_m
    T_level_sensor, information = registration.T_level_sensor, registration.information
    return native.faced_information(surface.fine.tables, still.points, T_level_sensor, information, reach_m)


def pose_covariance(
    information: NDArray[np.float64], T_map_level: Matrix, config: RegistrationConfig
) -> NDArray[np.float64]:
    """Covariance (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad (equation 7.3).

    A direction that the scan does not constrain (along a corridor) keeps the variance of the place, however
    many points there are. The variance never falls below a floor that the map's resolution sets.

    Args:
        information: (6, 6) over rotation then translation, along the level axes
            (``faced_information``).
    """
    return native.pose_covariance(information, T_map_level, config.map_voxel_m)


def free_directions(covariance: NDArray[np.float64]) -> tuple[FreeDirection, ...]:
    """Directions of a standard deviation above ``native.FREE_M`` or ``FREE_RAD`` (docs/method.md section 7).

    Args:
        covariance: (6, 6) over x, y, z, rotX, rotY, rotZ about the map's axes, in m and rad.

    Returns:
        Shifts before turns, of each the least certain first. Those of a kind are at right angles.
    """
    return tuple(
        FreeDirection(Motion.ROTATION if is_turn else Motion.TRANSLATION, direction, sigma)
        for is_turn, direction, sigma in native.free_axes(covariance)
    )

"""The verdict: from ranked poses to an answer, or to the reason why there is none.

The decision is compiled: ``native/include/firstfix/query/verdict.hpp``.
"""

from __future__ import annotations

from collections.abc import Sequence

from .. import native
from ..answer.localization import Hypothesis, Localization, Reason, Verdict
from ..answer.options import LocalizeOptions
from ..errors import InvalidOption
from ..transform import inverse
from .index import MapIndex
from .registered_candidate import RegisteredCandidate
from .registration.covariance import free_directions, pose_covariance
from .registration.surface import Surface


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
    config, T_map_level = best.index.config.registration, best.index.T_map_level
    information = best.registration.information if scan is None else best.faced_information(scan)
    covariance = pose_covariance(information, T_map_level, config)
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


def threshold_of(index: MapIndex, options: LocalizeOptions, map_id: str = "") -> float | None:
    """Threshold on the probability that the caller asks of a map; None: the map's own.

    Raises:
        InvalidOption: two thresholds are asked for, or no threshold of this map promises what is asked.
    """
    if options.max_false_accept is None:
        return options.min_probability
    if options.min_probability is not None:
        raise InvalidOption("min_probability and max_false_accept both set the threshold: give one")
    return index.false_accept_bound.min_probability(options.max_false_accept, map_id)


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

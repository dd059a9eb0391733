"""Results of a self-test, as the manifest keeps them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from firstfix.engine.calibration import Calibration
from firstfix.engine.false_accept_bound import FalseAcceptBound
from firstfix.transform import Matrix

from .localizability import QueriedPlace
from .outcome import RIGHT_M, Outcome
from .real_scans import RealScans, disagreeing
from .reliability import CrossValidated

LIMITS_M = (0.05, 0.2, 0.5, 1)


@dataclass(frozen=True)
class SelfTest:
    """Results of ``queries`` perturbed scans in the map and ``outside`` scans of strange places.

    Attributes:
        success: by limit, such as "0.2m": share of the queries whose best hypothesis is within the limit.
        among: the same for any hypothesis: the place was found, but not necessarily ranked first.
        localized: share of the queries answered ``localized``.
        found: share of the queries whose place is the best hypothesis, or ties with it. Equal storeys and
            known aliases tie: they make a map no worse.
        parts: ``queries``, ``success``, ``found`` and ``localized`` of those disturbed "as real" scans are,
            and of those disturbed "roughly".
        median_error_m: of the best hypotheses; None if half of the queries or more have none.
        false_accepts: number of answers ``localized`` that were off by over 1 m or 10 degrees, or outside.
        reliability: ``CrossValidated.reliability`` of all of them.
        false_accept_bound: ``CrossValidated.bound``, with hard negatives.
        threshold: result of ``threshold.choose`` for the config's promise; ``others``: for those of ``TOLD``.
        localizability: result of ``localizability.grid_of`` for the queries; the build adds what
            ``mapped_places.MappedPlaces`` knows.
        asked: ``Ended.to_mapping``: how many queries were planned, what share of them was asked, and why the
            test ended.
        real: the same of the real scans that were asked too: their number ``asked``, the ``weight`` of each
            among the calibration's cases, ``success``, ``localized``, ``median_error_m`` and
            ``false_accepts``; ``of_source``, how many of the scans came with the map's source, and how many
            of them were found; ``disagree``, which shares differ from those of the simulated scans by more
            than chance; ``left_out``, with reasons; ``held_out``, ``RealScans.parts``; and ``confirmed``,
            ``RealScans.confirmations``.
        with_prior: ``TaughtWithPrior.report``.
    """

    queries: int
    outside: int
    success: dict[str, float]
    among: dict[str, float]
    localized: float
    found: float
    parts: dict[str, dict[str, Any]]
    median_error_m: float | None
    false_accepts: int
    reliability: dict[str, Any]
    false_accept_bound: dict[str, Any]
    threshold: dict[str, Any]
    localizability: list[dict[str, object]]
    asked: dict[str, Any] = field(default_factory=dict)
    real: dict[str, Any] = field(default_factory=dict)
    with_prior: dict[str, Any] = field(default_factory=dict)

    def to_mapping(self) -> dict[str, Any]:
        """The results as JSON values."""
        return asdict(self)


def queried_places(
    outcomes: Sequence[Outcome], calibration: Calibration, T_level_map: Matrix
) -> list[QueriedPlace]:
    """The queries in the map, each with the most similar place elsewhere."""
    places = []
    for outcome in outcomes:
        if outcome.T_level_sensor is None:
            continue
        here = outcome.T_level_sensor[:3, 3]
        found = [(T_level_map @ h.T_map_sensor)[:3, 3] for h in outcome.answer.hypotheses]
        elsewhere = [at for at in found if np.linalg.norm(at - here) > RIGHT_M]
        accepted = outcome.accepted_by(calibration)
        named = ("localized" if outcome.right else "wrong") if accepted else "unsure"
        rival = elsewhere[0] if elsewhere else None
        places.append(QueriedPlace(here, named, rival, outcome.found_by(calibration)))
    return places


def summary_of(
    outcomes: Sequence[Outcome],
    calibration: Calibration,
    checked: CrossValidated,
    bound: FalseAcceptBound,
    threshold: dict[str, Any],
    localizability: list[dict[str, object]],
    asked: dict[str, Any],
) -> SelfTest:
    """The results of the simulated scans; those of real ones are added to them.

    Args:
        outcomes: of the simulated scans, in the map and elsewhere.
        checked: cases of all scans.
        asked: see ``SelfTest``.
    """
    inside = [outcome for outcome in outcomes if outcome.T_level_sensor is not None]
    errors = np.array([outcome.first_error_m for outcome in inside])
    accepted = [o for o in outcomes if o.accepted_by(calibration)]
    return SelfTest(
        queries=len(inside),
        outside=len(outcomes) - len(inside),
        success=_shares(errors),
        among=_shares(np.array([outcome.least_error_m for outcome in inside])),
        localized=_localized(inside, calibration),
        found=_share([o.found_by(calibration) for o in inside]),
        parts={
            "as real": part_of([outcome for outcome in inside if not outcome.is_rough], calibration),
            "roughly": part_of([outcome for outcome in inside if outcome.is_rough], calibration),
        },
        median_error_m=_median(errors),
        false_accepts=sum(not o.right for o in accepted),
        reliability=checked.reliability(),
        false_accept_bound=bound.to_mapping(),
        threshold=threshold,
        localizability=localizability,
        asked=asked,
    )


def part_of(outcomes: Sequence[Outcome], calibration: Calibration) -> dict[str, Any]:
    """The results of some of the simulated scans."""
    return {
        "queries": len(outcomes),
        "success": _shares(np.array([outcome.first_error_m for outcome in outcomes])),
        "found": _share([outcome.found_by(calibration) for outcome in outcomes]),
        "localized": _localized(outcomes, calibration),
    }


def results_of_real(
    found: SelfTest, outcomes: Sequence[Outcome], calibration: Calibration, real: RealScans, weight: float
) -> dict[str, Any]:
    """``SelfTest.real``; empty if the source has no real scans."""
    if not outcomes and not real.left_out and real.of_map is None:
        return {}
    errors = np.array([outcome.first_error_m for outcome in outcomes])
    success, localized = _shares(errors), _localized(outcomes, calibration)
    of_source = [
        o.found_by(calibration)
        for o, one in zip(outcomes, real.scans, strict=True)
        if one.confirmation is None
    ]
    return {
        "asked": len(outcomes),
        "weight": round(weight, 4),
        "success": success,
        "localized": localized,
        "median_error_m": _median(errors),
        "false_accepts": sum(o.accepted_by(calibration) and not o.right for o in outcomes),
        "of_source": {"asked": len(of_source), "found": sum(of_source)},
        "disagree": disagreeing(
            {**success, "localized": localized},
            {**found.success, "localized": found.localized},
            (len(outcomes), found.queries),
        ),
        "left_out": dict(sorted(real.left_out.items())),
        "held_out": real.parts(),
        "confirmed": real.confirmations(),
    }


def _localized(outcomes: Sequence[Outcome], calibration: Calibration) -> float:
    return _share([o.accepted_by(calibration) for o in outcomes])


def _share(of: Sequence[bool]) -> float:
    return round(float(np.mean(of)), 4) if of else 0.0


def _median(errors_m: NDArray[np.float64]) -> float | None:
    """Median error; None if there is none, as half of the scans or more found no place."""
    median = float(np.median(errors_m)) if len(errors_m) else np.inf
    return round(median, 4) if np.isfinite(median) else None


def _shares(errors_m: NDArray[np.float64]) -> dict[str, float]:
    """Share of the errors within each limit."""
    return {
        f"{limit}m": round(float(np.mean(errors_m <= limit)), 4) if len(errors_m) else 0.0
        for limit in LIMITS_M
    }

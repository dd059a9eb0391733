"""Known aliases of a map: how much of the lead of the true place do things lose that moved?

A scan that nothing disturbs fits its own place at least as well as any alias of it. So where an alias leads
by some support, disturbances took at least as much from the true place. What they take is measured.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from firstfix.answer.localization import Localization
from firstfix.answer.options import LocalizeOptions
from firstfix.builds.config import PerturbConfig
from firstfix.engine.candidates import Candidates
from firstfix.engine.hypotheses import HypothesisSearch
from firstfix.engine.index import MapIndex
from firstfix.engine.known_aliases import is_any_of, known_aliases
from firstfix.engine.localizer import Localizer
from firstfix.engine.stopwatch import Stopwatch
from firstfix.engine.told_apart import told_apart
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import Matrix, inverse, pose_error

from ..simulation.perturb import ScanCase, ScanSimulation

_TIED, _MIN_SCANS = 0.9, 20  # share of the losses that is less than the width, and scans to learn it from
_FOUND_M, _FOUND_DEG = 0.5, 5.0  # from the true pose


def alias_tie_width(
    lost: Sequence[float | None], min_margin: float, max_margin: float, asked: float = 1.0
) -> float:
    """Difference of support below which known aliases tie, from what the scans' ``lead_lost`` were.

    Of few places with aliases nothing is learned.

    Args:
        min_margin: below which all places tie.
        max_margin: a larger one counts as this.
        asked: 0..1, share of the planned scans that these are.
    """
    found = [by for by in lost if by is not None]
    if len(found) < _MIN_SCANS * asked:
        return min_margin
    most = min(float(np.quantile(found, _TIED)), max_margin)
    return max(min_margin, math.ceil(most * 1e4) / 1e4)


def lead_lost(
    localizer: Localizer,
    simulation: ScanSimulation,
    case: ScanCase,
    clean: NDArray[np.float32],
    scan: Scan,
    options: LocalizeOptions,
) -> float | None:
    """Support that a scan's disturbances take from the lead of its place over the best known alias.

    None if no known alias explains the scan nearly as well, or the true place cannot be aligned.

    Args:
        clean: ``ScanSimulation.clean_ranges`` of the case.
        scan: of the case, disturbed.
    """
    undisturbed = PerturbConfig(
        noise_m=simulation.config.noise_m,
        dropout=simulation.config.dropout,
        occluders=0,
        strangers=0,
        unmapped=0,
        vanished=0,
    )
    calm = ScanSimulation(simulation.simulator, simulation.sensor, undisturbed)
    aliases = known_aliases(localizer.index, case.T_level_sensor)
    if not len(aliases):
        return None
    before = _lead(localizer, calm.scan(case, clean=clean), case.T_level_sensor, aliases, options)
    if before is None:
        return None
    after = _lead(localizer, scan, case.T_level_sensor, aliases, options)
    return None if after is None else before - after


def aliases_among(index: MapIndex, answer: Localization) -> tuple[int, ...]:
    """Numbers of the hypotheses of an answer that are known aliases of the best one.

    Those are left out that the scan tells from the best one.
    """
    fits = [one.quality for one in answer.hypotheses if one.quality is not None]
    if not fits:
        return ()
    ranking = index.config.ranking
    T_level_sensor = inverse(index.T_map_level) @ [one.T_map_sensor for one in answer.hypotheses]
    known = known_aliases(index, T_level_sensor[0]).T_level_sensor
    is_alike = is_any_of(known, T_level_sensor, ranking) & ~told_apart(ranking, fits, T_level_sensor)
    return tuple(number for number in np.flatnonzero(is_alike).tolist() if number)


def _lead(
    localizer: Localizer, scan: Scan, T_level_sensor: Matrix, aliases: Candidates, options: LocalizeOptions
) -> float | None:
    """Lead in support of a true pose over the best of its known aliases."""
    index = localizer.index
    prepared = localizer.prepare(ScanSequence.single(scan), options, Stopwatch())
    if prepared is None:
        return None
    hypotheses = HypothesisSearch(index, prepared)
    aliases = hypotheses.not_far_behind(aliases, T_level_sensor)
    if not len(aliases):
        return None
    own = Candidates(aliases.template[:1], T_level_sensor[None], np.ones(1))
    placed = hypotheses.run(Candidates.merged([own, aliases]))
    off = [pose_error(T_level_sensor, one.registration.T_level_sensor) for one in placed]
    true = [
        one.support for one, (m, deg) in zip(placed, off, strict=True) if m < _FOUND_M and deg < _FOUND_DEG
    ]
    elsewhere = [
        one.support for one, (m, _) in zip(placed, off, strict=True) if m > index.config.ranking.same_pose_m
    ]
    return max(true) - max(elsewhere) if true and elsewhere else None

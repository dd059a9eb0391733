"""Screening: thousands of template poses are scored against the map, and the best become candidates."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...answer.options import LocalizeOptions
from ..candidates import Candidates, candidates_of_scan
from ..config import EffortConfig
from ..index import MapIndex
from ..preprocess import PreparedQuery, PreparedScan
from ..registered_candidate import distinct


def screened_candidates(
    index: MapIndex,
    prepared: PreparedQuery,
    levelled: Sequence[PreparedScan],
    options: LocalizeOptions,
    effort: EffortConfig,
) -> Candidates:
    """Distinct candidates whose poses fit the coarse map best, best first.

    The descriptor alone mistakes the place where sparse beams, occluders or a wrong up change many cells. A
    hundred points of the scan tell the places apart at a tenth of a registration's time.

    Args:
        levelled: the query's scans, each levelled in one way or several, which share the effort.
    """
    poses, clusters = (max(1, share // len(levelled)) for share in (effort.screened, effort.clusters))
    descriptor = index.cascade.descriptor
    found = Candidates.merged(
        [
            candidates_of_scan(
                index, scan.described_by(descriptor), scan, options.prior, poses, clusters, per_spot=None
            )
            for scan in levelled
        ]
    )
    found = found.at(np.argsort(found.template, kind="stable"))  # neighbours read the same part of the map
    T_level_sensor, score = index.surface.screen(prepared.sparse, found.T_level_sensor)
    best = np.argsort(-score, kind="stable")
    best = best[distinct(T_level_sensor[best], index.config.ranking, most=effort.candidates)]
    return Candidates(found.template[best], T_level_sensor[best], score[best])

"""Queries with a prior: another question than "where in the map?", so they have a calibration of their own.

Only what lies in the prior competes, so another share of the answers is right: places that look alike are out
of it, and where the prior is wrong, the best place in it is wrong (docs/method.md section 9).
"""

from __future__ import annotations

from dataclasses import replace

from ..answer.options import LocalizeOptions
from .index import MapIndex

MIN_RADIUS_M, MAX_RADIUS_M = 1.0, 10.0  # of the priors by which self-tests fit the calibration


def judging(index: MapIndex, options: LocalizeOptions) -> MapIndex:
    """The index with the calibration by which it judges a query of these options.

    A wide prior excludes too little to ask another question. Nor do queries with ``max_false_accept``: the
    bound that they ask for was measured without priors.
    """
    taught, prior = index.calibration.with_prior, options.prior
    if taught is None or prior is None or prior.radius_m > MAX_RADIUS_M:
        return index
    if options.max_false_accept is not None:
        return index
    return replace(index, calibration=taught)

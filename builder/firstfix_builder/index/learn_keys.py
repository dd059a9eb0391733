"""Learns the projection of keys that best tells this map's places apart, from its own perturbed simulations.

Linear discriminant analysis (docs/method.md 3.4): among templates keys should differ much, between a
place and a perturbed scan near it little. Fewer numbers are searched faster, and find more.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.spatial import cKDTree

from firstfix.builds.config import LearnKeysConfig
from firstfix.engine.config import EngineConfig
from firstfix.engine.retrieval.cascade import Templates

from ..execution.chunks import Arrays
from ..mesh.places.chance import rows_by_rank

TEMPLATES_A_SCAN = 4
COMPARED_TEMPLATES = 10_000  # enough for their covariance: the keys of 100k at once are gigabytes


def is_worth_learning(templates: int, engine: EngineConfig, config: LearnKeysConfig) -> bool:
    """Whether anything is to be gained.

    The paper's keys have 20 numbers. A map of hardly more templates than are compared anyway needs no key.
    """
    return bool(config.scans) and engine.descriptor.kind == "occupancy" and templates > engine.search.clusters


def learn_keys(
    templates: Templates, scans: Iterable[Arrays], engine: EngineConfig, config: LearnKeysConfig
) -> NDArray[np.float32] | None:
    """(d, numbers) by which keys are multiplied from the right. None where no scan could be taken.

    Args:
        scans: results of ``key_scans.key_scan_chunks``.
    """
    descriptor = engine.descriptor.make()
    made = [one for one in scans if len(one["position_m"])]
    if not made:
        return None
    spots = np.concatenate([one["position_m"] for one in made])
    seen = {name: np.concatenate([one[name] for one in made]) for name in descriptor.arrays}
    nearest = cKDTree(templates.position_m).query(spots)[1]
    sample = np.sort(rows_by_rank(templates.position_m, COMPARED_TEMPLATES, config.seed))
    return discriminants(
        descriptor.keys(templates.described_at(sample)),
        descriptor.keys(seen) - descriptor.keys(templates.described_at(nearest)),
        config.numbers,
        config.shrinkage,
    )


def scans_for(templates: int, config: LearnKeysConfig) -> int:
    """Number of scans to learn from: few templates need no better keys (docs/method.md section 3)."""
    return min(config.scans, -(-templates // TEMPLATES_A_SCAN))


def discriminants(
    keys: NDArray[np.float32], within: NDArray[np.float32], numbers: int, shrinkage: float
) -> NDArray[np.float32]:
    """Linear discriminant analysis: the directions w of the largest w'Bw / w'Ww, scaled so that w'Ww = 1.

    Args:
        keys: (n, d) of the templates, whose covariance is B.
        within: (m, d) differences between perturbed scans' keys and their places' own, whose scatter is W.
        shrinkage: 0..1, the share of W that is replaced by a multiple of the identity of the same trace.

    Returns:
        (d, numbers), or (d, d) where that is less.
    """
    scatter = within.T.astype(np.float64) @ within / len(within)
    d = len(scatter)
    scatter = (1 - shrinkage) * scatter + shrinkage * np.trace(scatter) / d * np.eye(d)
    centred = keys.astype(np.float64) - keys.mean(axis=0, dtype=np.float64)
    between = centred.T @ centred / len(keys)
    _, vectors = eigh(between, scatter, subset_by_index=[max(0, d - numbers), d - 1])
    return np.ascontiguousarray(vectors[:, ::-1], np.float32)

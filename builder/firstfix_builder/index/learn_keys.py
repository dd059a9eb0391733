"""Learns the projection of keys that best tells this map's places apart, from its own perturbed simulations.

Linear discriminant analysis (docs/method.md 3.4): among templates keys should differ much, between a
place and a perturbed scan near it little. Fewer numbers are searched faster, and find more.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.spatial import cKDTree

from firstfix.builds.config import LearnKeysConfig
from firstfix.descriptor import Described
from firstfix.engine.config import EngineConfig
from firstfix.engine.preprocess import preprocess
from firstfix.engine.retrieval.templates import Templates
from firstfix.errors import BuildCancelled
from firstfix.portable.sample import rows_by_chance
from firstfix.scan.sequence import ScanSequence
from firstfix.sensor import SensorModel

from ..simulation.perturb import ScanCase, ScanSimulation
from ..simulation.simulate import Simulator

TEMPLATES_A_SCAN = 4
COMPARED_TEMPLATES = 10_000  # enough for their covariance: the keys of 100k at once are gigabytes


def learn_keys(
    simulator: Simulator,
    sensor: SensorModel,
    templates: Templates,
    engine: EngineConfig,
    config: LearnKeysConfig,
    executor: Executor,
    progress: Callable[[float], None],
    cancelled: Callable[[], bool],
) -> NDArray[np.float32] | None:
    """(d, numbers) by which keys are multiplied from the right.

    None where nothing is to be gained: the paper's keys have 20 numbers, and a map of hardly more
    templates than are compared anyway needs no key.

    Raises:
        BuildCancelled: cancelled() said so.
    """
    if not config.scans or engine.descriptor.kind != "occupancy" or len(templates) <= engine.search.clusters:
        return None
    descriptor, done = engine.descriptor.make(), 0
    simulation = ScanSimulation(simulator, sensor, config.perturb)
    rng = np.random.default_rng(config.seed)
    count = scans_for(len(templates), config)
    cases = simulation.cases(templates.position_m, engine.spacing_m, count, rng)

    def described(case: ScanCase) -> Described | None:
        nonlocal done
        if cancelled():
            raise BuildCancelled("cancelled while learning keys")
        scan = ScanSequence.single(simulation.scan(case))
        prepared = preprocess(scan, None, engine.preprocess, sensor.R_base_sensor)
        done += 1
        progress(done / len(cases))
        return None if prepared is None else prepared.scans[0].described_by(descriptor)

    made = [(case, one) for case, one in zip(cases, executor.map(described, cases), strict=True) if one]
    if not made:
        return None
    seen = {name: np.concatenate([one[name] for _, one in made]) for name in descriptor.arrays}
    spots = np.array([case.T_level_sensor[:3, 3] for case, _ in made])
    nearest = cKDTree(templates.position_m).query(spots)[1]
    sample = rows_by_chance(len(templates), COMPARED_TEMPLATES)  # they stand column by column
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

"""The queries: as in the paper the templates themselves, and held-out, perturbed scans beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firstfix.descriptor import ScanBatch
from firstfix.engine.config import PreprocessConfig
from firstfix.engine.preprocess import preprocess
from firstfix.scan.scan import Scan
from firstfix.scan.sequence import ScanSequence
from firstfix.transform import Matrix

from .scene import DESCRIPTORS, SENSOR, Scene, Taken

SEED = 1


def templates_themselves(scene: Scene, count: int) -> Taken:
    """The paper's protocol: ``count`` of the templates, all where there are no more."""
    every = len(scene.templates)
    rows = np.sort(np.random.default_rng(SEED).permutation(every)[:count])
    return scene.templates.subset(rows)


@dataclass(frozen=True)
class Perturbed:
    """Held-out scans between the templates, any heading, with all that goes wrong.

    Attributes:
        scans: in the sensor frame, and T_map_sensor.
        as_they_come: described in the sensor frame, at the nominal height, as the paper does.
        levelled: described after firstfix has found up and the floor.
    """

    scans: list[tuple[Scan, Matrix]]
    as_they_come: Taken
    levelled: Taken


def perturbed(scene: Scene, count: int) -> Perturbed:
    scans = scene.perturbed(count, SEED)
    true_m = np.array([T[:3, 3] for _, T in scans])
    config = PreprocessConfig(min_range_m=SENSOR.min_range_m, default_height_m=scene.mount_m)
    raw = [ScanBatch.single(scan.points, scene.mount_m) for scan, _ in scans]
    level = []
    for scan, _ in scans:
        prepared = preprocess(ScanSequence.single(scan), None, config)
        level.append(raw[len(level)] if prepared is None else prepared.scans[0].batch)
    return Perturbed(scans, _described(true_m, raw), _described(true_m, level))


def _described(true_m: NDArray[np.floating], scans: list[ScanBatch]) -> Taken:
    by = {}
    for name, how in DESCRIPTORS.items():
        each = [how.describe(scan) for scan in scans]
        by[name] = {array: np.concatenate([one[array] for one in each]) for array in how.arrays}
    return Taken(true_m, by)

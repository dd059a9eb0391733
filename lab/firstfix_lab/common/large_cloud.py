"""A version whose cloud is as large as one asks for."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from firstfix.catalog.manifest import VIEWER_FILES
from firstfix_builder.index.cloud_octree import CloudOctree

SEED = 7


def version_with_cloud(version: Path, folder: Path, points: int, templates: int) -> None:
    """Make a version of another's files, but with the cloud of a building with many floors and walls."""
    folder.mkdir(parents=True)
    for path in version.iterdir():
        if path.is_file() and path.name not in VIEWER_FILES:  # no sightings of a store
            os.link(path, folder / path.name)
    rng = np.random.default_rng(SEED)
    points_m = np.empty((points, 3), np.float32)
    for first in range(0, points, 1 << 20):
        part = points_m[first : first + (1 << 20)]
        part[:] = rng.uniform([0, 0, 0], [200, 120, 16], part.shape)
        flat, step_m = rng.integers(0, 3, len(part)), np.array([5.0, 6.0, 4.0])
        rows = np.arange(len(part))
        part[rows, flat] = np.round(part[rows, flat] / step_m[flat]) * step_m[flat]
    marks_m = rng.uniform([0, 0, 1], [200, 120, 15], (templates, 3))
    CloudOctree.of(points_m, marks={"templates": marks_m}).save(folder)

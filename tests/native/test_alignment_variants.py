"""Alignment and free space in every instruction set: the same to the last bit."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from firstfix.native import choice

REPO = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow
ALIGNED = """
import hashlib
import numpy as np
from scipy.spatial.transform import Rotation
from firstfix import native
from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid
from firstfix.engine.verification.free_space import MapView
from firstfix.scan.range_view import RangeView

rng = np.random.default_rng(3)
points = rng.uniform([-9, -7, -1], [9, 7, 2], (9000, 3)).astype(np.float32)
wall = rng.integers(0, 3, len(points))
off = rng.normal(0, 0.02, len(points)).astype(np.float32)
points[np.arange(len(points)), wall] = np.float32([9, 7, -1])[wall] + off
surface = Surface(points, np.float32(-np.eye(3))[wall], np.ones(len(points), np.bool_))
grid, view = SurfaceGrid.of(surface, 0.3), MapView.of(points, 25.0)
scan = surface.at(slice(0, None, 7))
T = np.tile(np.eye(4), (20, 1, 1))
T[:, :3, :3] = Rotation.from_rotvec(rng.normal(0, 0.03, (20, 3))).as_matrix()
T[:, :3, 3] = rng.normal(0, 0.1, (20, 3))
found = native.align(grid.tables, scan.points, scan.normals, scan.oriented, T, 12, 0.5, 0.06, 0.15)
assert found[1].mean() > 0.5
seen = [view.free_space_violation(RangeView.of(scan.points), pose) for pose in found[0]]
found_bytes = b"".join([array.tobytes() for array in found] + [repr(seen).encode()])
print(native.variant, hashlib.sha256(found_bytes).hexdigest())
"""


def test_a_scan_is_aligned_to_the_same_bits():
    variants, digests = choice.runnable(), set()
    for variant in variants:
        environment = {**os.environ, "FIRSTFIX_NATIVE": variant}
        done = subprocess.run(
            [sys.executable, "-c", ALIGNED],
            cwd=REPO,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        name, digest = done.stdout.split()
        assert name == variant
        digests.add(digest)
    assert len(digests) == 1

"""A map small enough for thousands of it: a yard of 16 x 12 m with boxes, built for a sensor of 16 rings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from firstfix.builds.config import BuildConfig
from firstfix_builder.pipeline import build_version

from .load import Body

if TYPE_CHECKING:
    from trimesh import Trimesh

SENSOR = {
    "name": "bench-16",
    "elevations_deg": [float(v) for v in np.linspace(-15, 15, 16)],
    "azimuth_step_deg": 1.0,
    "min_range_m": 0.3,
    "max_range_m": 60.0,
    "mount_height_m": 0.8,
}
CONFIG = {"sensor": SENSOR, "self_test": {"queries": 4, "outside": 2}}
SEED = 4


def make_small_map(folder: Path) -> Path:
    """The folder of its version, some 3 MB."""
    folder.mkdir(parents=True)
    mesh = folder / "yard.ply"
    make_small_mesh().export(mesh)
    return build_version(mesh, BuildConfig.parse(CONFIG), folder / "work").directory


def make_small_mesh() -> Trimesh:
    """The yard: floor, four walls and boxes."""
    import trimesh

    rng = np.random.default_rng(SEED)
    boxes = [((16.4, 12.4, 0.2), (0.0, 0.0, -0.1))]
    boxes += [((0.2, 12.4, 3.0), (x, 0.0, 1.5)) for x in (-8.1, 8.1)]
    boxes += [((16.4, 0.2, 3.0), (0.0, y, 1.5)) for y in (-6.1, 6.1)]
    for _ in range(12):
        size = rng.uniform(0.4, 1.8, 3)
        boxes.append((tuple(size), (*rng.uniform([-7, -5], [7, 5]), size[2] / 2)))
    parts = [trimesh.creation.box(size, trimesh.transformations.translation_matrix(at)) for size, at in boxes]
    return trimesh.util.concatenate(parts)


def query_of(version: Path) -> Body:
    """A query: the map's points within 8 m of one of its templates."""
    points = np.load(version / "map_points.npy").astype(np.float64)
    position = np.load(version / "template_position_m.npy")[0]
    seen = points[:, :3] - position
    near = seen[np.linalg.norm(seen, axis=1) < 8.0]
    return Body("application/vnd.firstfix.xyz", near.astype("<f4").tobytes())

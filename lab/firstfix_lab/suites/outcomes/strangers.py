"""Simulated scans of places that no user's map has: what the self-test of every map is asked, too."""

from __future__ import annotations

import zipfile
from pathlib import Path
from zlib import crc32

import numpy as np

from firstfix.builds.config import PerturbConfig
from firstfix.scan.condense import condense
from firstfix.scan.scan import Scan
from firstfix.sensor import preset
from firstfix.wire.query import encode_query
from firstfix_builder.simulation.perturb import perturbed_scans
from firstfix_builder.simulation.simulate import Simulator
from firstfix_cli.sample_world.drive import drive

from ...common.worlds import layout

KINDS, SEEDS = ("factory", "office", "campus", "farm"), (31, 32)  # of no world that a suite measures in
SENSORS = ("os1-64", "os0-64", "hdl-32e", "vlp-16", "xt32", "mid-360")
_MADE = (2026, 1, 1, 0, 0, 0)  # equal scans give equal bytes


def write_strangers(path: Path) -> int:
    """Write one scan of each place by each sensor, as compact queries, and return their number.

    The scans are disturbed as those of a self-test are.
    """
    written = 0
    with zipfile.ZipFile(path, "w") as archive:
        for seed in SEEDS:
            for kind in KINDS:
                for sensor, scan in zip(SENSORS, _scans(kind, seed), strict=True):
                    name = zipfile.ZipInfo(f"{kind}_{seed}_{sensor}.query", _MADE)
                    archive.writestr(name, encode_query(condense(scan)))
                    written += 1
    return written


def _scans(kind: str, seed: int) -> list[Scan]:
    place = layout(kind, seed)
    mesh, at_m = place.mesh(), drive(place)[:, :3, 3]
    simulator = Simulator(mesh.vertices, mesh.triangles)
    rng = np.random.default_rng([seed, crc32(kind.encode())])
    return [
        perturbed_scans(simulator, preset(sensor), at_m, 1.0, 1, PerturbConfig(), rng)[0][0]
        for sensor in SENSORS
    ]

"""Sensors of a case in a world. They depend on its name alone, not on other worlds or cases."""

from __future__ import annotations

from collections.abc import Iterator
from zlib import crc32

import numpy as np

from ...common.worlds import BenchWorld
from .cases import ANY, OTHER, SENSORS, Case

SEED = 12
_TEMPLATES = {  # dealt out, so that each kind of sensor makes some map
    "warehouse_aws_small": "mid-360",
    "hospital_aws_1floor": "vlp-16",
    "office_willow_garage": "hdl-32e",
    "office_clearpath": "qt64",
    "factory": "hdl-64e",
    "office": "xt32",
    "office_ground_floor": "mid-360",
    "campus": "os1-32",
    "inspection_clearpath": "os1-64",
    "office_mapped": "vlp-16",
}


def template_sensor(case: Case, world: BenchWorld) -> str | None:
    """Preset of the case's templates; None: the world's own."""
    if case.templates != OTHER:
        return case.templates
    others = [name for name in SENSORS if name != world.config["sensor"]]
    return _TEMPLATES.get(world.name) or str(_rng(world, OTHER).choice(others))


def asking_sensors(case: Case, world: BenchWorld, count: int) -> Iterator[tuple[str | None, int]]:
    """Presets that ask and their numbers of scans, ``count`` in all; None: the world's own."""
    if case.queries != ANY:
        yield case.queries, count
        return
    order = _rng(world, case.name).permutation(SENSORS)
    for name, share in zip(order, np.array_split(np.arange(count), len(order)), strict=True):
        if len(share):
            yield str(name), len(share)


def _rng(world: BenchWorld, what: str) -> np.random.Generator:
    return np.random.default_rng([SEED, crc32(world.name.encode()), crc32(what.encode())])

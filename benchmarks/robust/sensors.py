"""Which sensors a case has in a world: drawn by the world's name, so that no other world or case matters."""

from __future__ import annotations

from collections.abc import Iterator
from zlib import crc32

import numpy as np

from ..common.worlds import BenchWorld
from .cases import ANY, OTHER, SENSORS, Case

SEED = 12


def template_sensor(case: Case, world: BenchWorld) -> str | None:
    """Preset of the case's templates; None: the world's own."""
    if case.templates != OTHER:
        return case.templates
    others = [name for name in SENSORS if name != world.config["sensor"]]
    return str(_rng(world, OTHER).choice(others))


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

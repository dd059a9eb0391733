"""Fixtures of several parts of the engine: recorded places, and halls whose rack has come or gone."""

import numpy as np
import pytest

from firstfix.engine.registration.surface import Surface
from firstfix.engine.registration.surface_grid import SurfaceGrid
from tests.changed_hall import Hall, pose, standing
from tests.reference.recorded_places import MAPS, RecordedPlace, recorded_place

HALL_M = (16.0, 10.0, 4.0)
RACK = (9.2, 4.2, 0.0, 10.3, 6.3, 2.3)
AT = pose(4.1, 5.2)


@pytest.fixture(scope="module", params=list(MAPS))
def place(request: pytest.FixtureRequest) -> RecordedPlace:
    return recorded_place(request.param)


@pytest.fixture(scope="module")
def empty() -> Hall:
    return Hall(HALL_M, standing())


@pytest.fixture(scope="module")
def racked() -> Hall:
    return Hall(HALL_M, standing(RACK))


def slab(count: int = 4000) -> tuple[SurfaceGrid, Surface]:
    """A bumpy floor and a scan of it."""
    points = np.random.default_rng(7).uniform([-8, -8, -0.05], [8, 8, 0.05], (count, 3)).astype(np.float32)
    surface = Surface(points, np.tile(np.float32([0, 0, 1]), (count, 1)), np.ones(count, np.bool_))
    return SurfaceGrid.of(surface, 0.3), surface.at(slice(0, None, 9))

"""One place for each block and storey."""

from __future__ import annotations

import numpy as np

from firstfix_builder.viewpoints.even_sample import FloorPoints, one_per_block


def test_the_place_nearest_to_the_centre_stands_for_its_block_and_storey():
    xy = np.array([[0.1, 0.1], [0.9, 1.2], [1.9, 0.3], [2.1, 0.3], [1.1, 0.9], [-0.1, 0.5]])
    z = np.array([0.0, 0.2, 0.4, 0.0, 3.0, 0.0])
    block, standing = one_per_block(FloorPoints.alone(xy, z), 2.0)
    assert block[0] == block[1] == block[2]
    assert len({block[0], block[3], block[4], block[5]}) == 4
    assert set(standing) == {1, 3, 4, 5}
    assert (block[standing] == np.arange(4)).all()


def test_places_elsewhere_change_nothing():
    rng = np.random.default_rng(0)
    xy, z = rng.uniform(0, 40, (500, 2)), rng.uniform(0, 3, 500)
    more = rng.uniform([-90, -90], [-1, 90], (300, 2))
    alone = set(one_per_block(FloorPoints.alone(xy, z), 2.0)[1].tolist())
    every = FloorPoints.alone(np.concatenate([more, xy]), np.concatenate([np.zeros(300), z]))
    _, standing = one_per_block(every, 2.0)
    assert {row - 300 for row in standing.tolist() if row >= 300} == alone


def test_parts_are_thinned_alone_and_then_together_as_all_at_once():
    rng = np.random.default_rng(1)
    xy, z = rng.uniform(0, 8, (600, 2)), rng.uniform(0, 9, 600)
    part = rng.integers(0, 4, 600)
    group, standing = one_per_block(FloorPoints.alone(xy, z), 2.0, part)
    assert len(standing) == group.max() + 1 > 60
    low, high = (np.array([pick(z[group == one]) for one in range(len(standing))]) for pick in (min, max))
    left = FloorPoints(xy[standing], z[standing], low, high)
    again = standing[one_per_block(left, 2.0)[1]]
    assert set(again.tolist()) == set(one_per_block(FloorPoints.alone(xy, z), 2.0)[1].tolist())
    assert len(again) < len(standing)

"""One place for each block and storey."""

from __future__ import annotations

import numpy as np

from firstfix_builder.viewpoints.one_per_block import one_per_block


def test_the_place_nearest_to_the_centre_stands_for_its_block_and_storey():
    xy = np.array([[0.1, 0.1], [0.9, 1.2], [1.9, 0.3], [2.1, 0.3], [1.1, 0.9], [-0.1, 0.5]])
    z = np.array([0.0, 0.2, 0.4, 0.0, 3.0, 0.0])
    block, standing = one_per_block(xy, z, 2.0)
    assert block[0] == block[1] == block[2]
    assert len({block[0], block[3], block[4], block[5]}) == 4
    assert set(standing) == {1, 3, 4, 5}
    assert (block[standing] == np.arange(4)).all()


def test_places_elsewhere_change_nothing():
    rng = np.random.default_rng(0)
    xy, z = rng.uniform(0, 40, (500, 2)), rng.uniform(0, 3, 500)
    more = rng.uniform([-90, -90], [-1, 90], (300, 2))
    alone = set(one_per_block(xy, z, 2.0)[1].tolist())
    _, standing = one_per_block(np.concatenate([more, xy]), np.concatenate([np.zeros(300), z]), 2.0)
    assert {row - 300 for row in standing.tolist() if row >= 300} == alone

"""A map of two storeys is a good one, however often the mapping run took the stairs."""

from __future__ import annotations

import numpy as np

from firstfix_builder.sources.check_map.check_map import check_map
from firstfix_builder.sources.read_map.map_data import MapData
from firstfix_lab.worlds import make_world


def test_the_way_up_and_down_a_staircase_doubles_no_floor():
    world = make_world("office", seed=13)  # of two storeys
    there_and_back = np.concatenate([world.trajectory, world.trajectory[::-1]])
    found = check_map(MapData(points=world.cloud, trajectory=there_and_back), there_and_back)
    assert [one.code for one in found] == []

from __future__ import annotations

import numpy as np

from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.sources.sessions.merge import seen_through
from tests.builder.box_scenes import box, floor, sampled, walls

ROOM = [floor(0, 0, 12, 8), *walls(0, 0, 12, 8)]
CUPBOARD = box((5, 3, 0), (6, 4, 1.5))
DRIVE = np.tile(np.eye(4), (8, 1, 1))
DRIVE[:, :3, 3] = [[x, 1.0, 0.8] for x in np.linspace(2, 10, 8)]


def simulator(*parts):
    mesh = Mesh.joined(parts)
    return Simulator(mesh.vertices, mesh.triangles)


def test_what_was_carried_away_goes_and_the_rest_stays():
    gone = sampled(CUPBOARD, 40)
    gone = gone[gone[:, 2] > 0.31]  # what is nearer to the floor cannot be told from it
    stays = sampled(Mesh.joined(ROOM), 20)
    later = simulator(*ROOM)
    assert seen_through(gone, later, DRIVE).mean() > 0.95
    assert not seen_through(stays, later, DRIVE).any()


def test_what_is_still_there_stays_and_hides_what_is_behind_it():
    behind = np.array([[5.5, 5.5, 0.5]])  # a thing that nobody saw the second time
    later = simulator(*ROOM, CUPBOARD, box((3, 4.2, 0), (8, 4.4, 2.9)))
    points = np.concatenate([sampled(CUPBOARD, 40), behind])
    assert not seen_through(points, later, DRIVE).any()


def test_where_the_later_session_mapped_nothing_behind_it_says_nothing():
    later = simulator(floor(0, 0, 12, 2))  # it saw the floor near its path, no more
    assert not seen_through(sampled(CUPBOARD, 40)[:, :] + [0, 0, 0.5], later, DRIVE).any()


def test_one_place_alone_is_no_evidence():
    gone = sampled(CUPBOARD, 40) + [0, 0, 0.4]
    assert not seen_through(gone, simulator(*ROOM), DRIVE[:1]).any()


def test_nothing_is_said_from_afar():
    gone = sampled(CUPBOARD, 40) + [0, 0, 0.4]
    far = DRIVE.copy()
    far[:, 0, 3] -= 40
    assert not seen_through(gone, simulator(floor(-60, -20, 40, 20), *walls(-60, -20, 40, 20)), far).any()

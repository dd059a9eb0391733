"""A city is made block by block: the same bytes whatever its extent. Its files are a map's source."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.errors import InvalidOption
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.sources.read_map import read_parts
from firstfix_lab.worlds import write_city
from firstfix_lab.worlds.city.city import City
from firstfix_lab.worlds.city.layout import BLOCK_M
from firstfix_lab.worlds.city.write_city import city_queries, write_meshes


def test_a_block_depends_on_its_number_and_the_seed_alone():
    small, large, other = (city.block(1, 2).mesh() for city in (City(3, 5), City(90, 5), City(3, 6)))
    assert small.vertices.tobytes() == large.vertices.tobytes()
    assert small.triangles.tobytes() == large.triangles.tobytes()
    assert small.vertices.tobytes() != other.vertices.tobytes()
    assert City(3, 5).block(2, 2).mesh().vertices.tobytes() != small.vertices.tobytes()


def test_blocks_meet_without_a_step_and_streets_are_free():
    city = City(2, 4)
    mesh = Mesh.joined(city.block(i, j).mesh() for i in range(2) for j in range(2))
    simulator = Simulator(mesh.vertices, mesh.triangles)
    along = np.arange(1.0, 2 * BLOCK_M - 1, 0.5)
    street = np.column_stack([along, np.full(len(along), BLOCK_M + 0.01)])
    start, z, _ = simulator.crossings(street, 0.02, 200)
    lowest = z[start[1:] - 1]
    assert np.abs(np.diff(lowest)).max() < 0.1
    feet = np.column_stack([street, lowest + 0.8])
    assert simulator.is_free(feet, 0.5).all()
    high = mesh.vertices[:, 2].max() - mesh.vertices[:, 2].min()
    assert high > 10


def test_the_files_hold_every_block(tmp_path: Path):
    city = City(5, 1)
    write_meshes(city, tmp_path / "mesh")
    parts = list(read_parts(tmp_path / "mesh"))
    assert len(parts) == 4
    count = sum(len(city.block(i, j).mesh().triangles) for i in range(5) for j in range(5))
    assert sum(len(part.surface[1]) for part in parts) == count


def test_scans_are_taken_in_the_streets_at_their_poses():
    city = City(3, 2)
    (query,) = city_queries(city, 1)
    T = query.T_map_sensor
    assert T is not None
    assert (np.abs(T[:2, 3] / BLOCK_M - np.round(T[:2, 3] / BLOCK_M)) * BLOCK_M < 4).any()
    seen = query.scan.points @ T[:3, :3].T + T[:3, 3]
    near = seen[np.linalg.norm(seen[:, :2] - T[:2, 3], axis=1) < 30]
    place = city.around(*np.floor(T[:2, 3] / BLOCK_M).astype(int).tolist(), 1).mesh()
    distance = Simulator(place.vertices, place.triangles).distance(near)
    assert np.mean(distance < 0.15) > 0.8  # the rest are people, and what has moved


@pytest.mark.parametrize(("extent_m", "seed"), [(10.0, 0), (1e6, 0), (400.0, -1), (float("nan"), 0)])
def test_no_city_of_no_extent(tmp_path: Path, extent_m: float, seed: int):
    with pytest.raises(InvalidOption):
        write_city(tmp_path, extent_m=extent_m, seed=seed)

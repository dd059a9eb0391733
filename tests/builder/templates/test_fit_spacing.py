"""Viewpoints stand where they tell something: close in rooms, apart in the open, none where none can."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.builds.config import ViewpointConfig
from firstfix.sensor import SensorModel
from firstfix_builder.execution.chunks import Arrays, Chunk
from firstfix_builder.execution.stage_cache import StageResult
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.tiled_mesh import TiledMesh
from firstfix_builder.simulation.simulate import Simulator
from firstfix_builder.templates.fit_spacing import ROOM_SPACING_M, fitting_viewpoints, write_places
from firstfix_builder.templates.view_distance import OPEN_SPACING_M, ViewRays
from firstfix_builder.viewpoints.sample import DEFAULT_SPACING_M
from tests.builder.box_scenes import box, floor, walls

SENSOR = SensorModel("rings", tuple(np.linspace(-20, 20, 32).tolist()), 1.0, 0.1, 45.0, 0.8)


def field(*more: Mesh) -> list[Mesh]:
    """A street of blocks that ends in ground with nothing on it."""
    blocks = [box((x, y, -0.1), (x + 8, y + 6, 7)) for x in range(0, 60, 9) for y in (-9, 3)]
    return [floor(0, -40, 130, 40), *blocks, *more]


def finished(folder: Path) -> StageResult:
    return StageResult(folder.name, folder, folder.name)


def sampled(parts: list[Mesh], **config: object) -> tuple[NDArray[np.float64], float]:
    """Positions and spacing of the stage."""
    with TemporaryDirectory() as name:
        mesh, read, out = (Path(name) / part for part in ("mesh", "map", "out"))
        for folder in (mesh, read, out):
            folder.mkdir()
        TiledMesh.of(Mesh.joined(parts)).save(mesh)
        inputs = {"mesh": mesh, "map": read}
        chosen = ViewpointConfig.model_validate(config)

        def run(chunks: Sequence[Chunk], **places: Path) -> Iterator[Arrays]:
            return (chunk.run({**inputs, **places}) for chunk in chunks)

        def places_at(spacing_m: float) -> StageResult:
            folder = Path(name) / f"{spacing_m}"
            folder.mkdir()
            write_places(run, read, mesh, chosen, spacing_m, SENSOR, folder)
            return finished(folder)

        fitting_viewpoints(
            places_at, lambda places, chunks: run(chunks, places=places.directory), chosen, SENSOR, out
        )
        return np.load(out / "positions.npy"), float(np.load(out / "spacing_m.npy"))


@pytest.mark.parametrize(("step_m", "left_out_m2"), [(1.0, 42), (3.0, 0)])
def test_the_stage_says_how_much_of_the_seen_floor_no_step_reaches(step_m: float, left_out_m2: float):
    parts = [floor(0, 0, 8, 6), box((8, 0, -0.1), (15, 6, 0.6))]
    track = np.tile(np.eye(4), (3, 1, 1))
    track[:, :3, 3] = [[1.0 + step_m * number, 3.0, 1.5] for number in range(3)]
    with TemporaryDirectory() as name:
        mesh, read, out = (Path(name) / part for part in ("mesh", "map", "out"))
        for folder in (mesh, read, out):
            folder.mkdir()
        TiledMesh.of(Mesh.joined(parts)).save(mesh)
        np.save(read / "trajectory.npy", track)

        def run(chunks: Sequence[Chunk]) -> Iterator[Arrays]:
            for chunk in chunks:
                chunk.reads({"mesh": finished(mesh), "map": finished(read)})
                yield chunk.run({"mesh": mesh, "map": read})

        write_places(run, read, mesh, ViewpointConfig(), 1.0, SENSOR, out)
        left_out, positions = np.load(out / "left_out.npy"), np.load(out / "positions.npy")
    assert len(left_out) == pytest.approx(left_out_m2, abs=6)
    assert (positions[:, 0] > 8.3).any() == (left_out_m2 == 0)
    assert len(left_out) + len(positions) == pytest.approx(90, abs=6)


def test_a_room_has_close_viewpoints():
    room = [floor(0, 0, 8, 6), *walls(0, 0, 8, 6), floor(0, 0, 8, 6, 3)]
    found, spacing_m = sampled(room)
    assert spacing_m == ROOM_SPACING_M
    assert len(found) > 3 * 48 * 0.7


def test_over_open_ground_one_stands_for_four_and_where_nothing_is_seen_none():
    found, spacing_m = sampled(field())
    every, _ = sampled(field(), spacing_m=DEFAULT_SPACING_M)
    assert spacing_m == OPEN_SPACING_M
    assert {tuple(point) for point in found} < {tuple(point) for point in every}
    empty = every[:, 0] > 60 + 46  # beyond the sensor's range of every block
    assert empty.sum() > 500
    assert not (found[:, 0] > 60 + 47).any()
    wide = (found[:, 1] > 12) & (found[:, 0] < 90) & (found[:, 0] > 10)
    assert wide.sum() > 100
    was = (every[:, 1] > 12) & (every[:, 0] < 90) & (every[:, 0] > 10)
    assert wide.sum() < 0.5 * was.sum()


def test_a_spacing_that_is_set_is_kept():
    _, spacing_m = sampled(field(), spacing_m=1.5)
    assert spacing_m == 1.5


def test_viewpoints_far_from_a_change_stay_as_they_were_to_the_last_bit():
    before, _ = sampled(field())
    after, _ = sampled(field(box((10.0, 20.0, -0.1), (14.0, 24.0, 90.0))))
    far = [{point.tobytes() for point in found if point[0] > 62} for found in (before, after)]
    assert len(far[0]) > 100
    assert far[0] == far[1]
    assert {point.tobytes() for point in before} != {point.tobytes() for point in after}


def test_how_far_one_sees_is_that_of_the_place():
    mesh = Mesh.joined([floor(-30, -30, 30, 30), *walls(-4, -4, 4, 4), box((200, 200, 0), (201, 201, 1))])
    simulator = Simulator(mesh.vertices, mesh.triangles)
    positions = np.array([[0.0, 0, 0.8], [20, 0, 0.8], [300, 300, 0.8], [-29.0, 29, 0.8]])
    view_m, tells = ViewRays.of(SENSOR).at(simulator, positions, np.zeros(4))
    assert 4 < view_m[0] < 6
    assert np.isinf(view_m[1:]).all()  # walls on one side, or nowhere
    assert tells.tolist() == [True, True, False, True]

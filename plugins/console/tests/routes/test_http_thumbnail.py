"""The small picture of a version: the map from above, coloured by height, without its ceiling."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from firstfix.catalog.manifest import Manifest
from firstfix.catalog.viewer_cloud import POINT
from firstfix_builder.index.cloud_octree import CloudOctree, octahedral
from firstfix_console.thumbnail import GROUND, HEIGHT_PX, TURBO, WIDTH_PX, drawn
from tests.service.service_world import Service

RNG = np.random.default_rng(1)


def hall() -> tuple[NDArray[np.float64], NDArray[np.int8]]:
    """A floor of 24 x 12 m, a block of 2 m height in its north-east, and a ceiling over all of it."""
    floor = RNG.uniform([0, 0, 0], [24, 12, 0], (60_000, 3))
    block = RNG.uniform([18, 8, 2], [22, 11, 2], (8_000, 3))
    ceiling = RNG.uniform([0, 0, 4], [24, 12, 4], (60_000, 3))
    up, down = np.array([0.0, 0, 1]), np.array([0.0, 0, -1])
    normals = np.concatenate([np.tile(up, (68_000, 1)), np.tile(down, (60_000, 1))])
    return np.concatenate([floor, block, ceiling]), octahedral(normals)


def test_the_picture_is_the_map_from_above(service: Service):
    folder = service.scratch / "drawn"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("7")
    points, normals = hall()
    CloudOctree.of(points, normals).save(folder)
    version = service.catalog.publish("hall", folder, Manifest.for_directory(folder))
    answer = service.http.get(f"/maps/hall/versions/{version}/thumbnail")
    assert answer.headers["content-type"] == "image/png"
    assert "immutable" in answer.headers["cache-control"]
    picture = np.asarray(Image.open(io.BytesIO(answer.content)).convert("RGB")).astype(int)
    assert picture.shape == (HEIGHT_PX, WIDTH_PX, 3)
    assert (picture[0] == GROUND).all(), "a margin above: the hall is twice as long as wide"
    low = np.abs(picture - TURBO[0]).max(axis=2) < 30  # floor
    assert low[HEIGHT_PX // 2, WIDTH_PX // 4], "below the ceiling, the floor is seen"
    rows, columns = np.nonzero(np.abs(picture - TURBO[-1]).max(axis=2) < 30)  # block
    assert len(rows)
    assert np.median(columns) > 0.7 * WIDTH_PX, "east is at the right"
    assert np.median(rows) < 0.5 * HEIGHT_PX, "north is above"


def test_a_version_without_a_cloud_has_no_picture(service: Service):
    folder = service.scratch / "bare"
    folder.mkdir(parents=True)
    (folder / "label.txt").write_text("7")
    version = service.catalog.publish("hall", folder, Manifest.for_directory(folder))
    answer = service.http.get(f"/maps/hall/versions/{version}/thumbnail")
    assert answer.status_code == 404
    assert "has no cloud for viewers" in answer.json()["detail"]


def test_few_points_and_strays_are_drawn():
    one = np.zeros(1, POINT)
    assert drawn(one).shape == (HEIGHT_PX, WIDTH_PX, 3)
    many = np.zeros(20_000, POINT)
    many["at"][:, :2] = RNG.integers(30_000, 33_000, (20_000, 2))
    many["at"][:5] = 65_535  # seen through a window
    picture = drawn(many)
    columns = np.nonzero((picture != GROUND).any(axis=(0, 2)))[0]
    assert columns[-1] - columns[0] > WIDTH_PX / 2, "a stray does not make the map a dot"

"""The surface that a cloud gets when the config says "auto"."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from firstfix.builds.config import BuildConfig, ReconstructConfig
from firstfix_builder.mesh.reconstruct import PoissonChunk, SignedDistanceChunk, mesh_chunks
from firstfix_builder.simulation.simulate import upright

POSES = upright(np.array([[5.0, 5.0, 1.5], [15.0, 5.0, 1.5]]))


def floor(thin_share: float) -> NDArray[np.float64]:
    """A raster of 0.1 m, and a share of its points once more, four times as far apart."""
    dense = np.stack(np.meshgrid(np.arange(0, 10, 0.1), np.arange(0, 10, 0.1)), axis=-1).reshape(-1, 2)
    sparse = 4 * dense[: int(thin_share * len(dense))] + [20, 0]
    points = np.concatenate([dense, sparse])
    return np.column_stack([points, np.zeros(len(points))])


def chosen(points: NDArray[np.float64], poses: NDArray[np.float64] | None, **config: str) -> type:
    (kind,) = {type(chunk) for chunk in mesh_chunks(points, poses, ReconstructConfig(**config))}
    return kind


def test_a_cloud_with_a_trajectory_gets_the_signed_distance():
    assert chosen(floor(0.0), POSES) is SignedDistanceChunk
    assert chosen(floor(0.5), POSES) is SignedDistanceChunk


def test_an_uneven_cloud_without_a_trajectory_gets_poisson():
    assert chosen(floor(0.0), None) is SignedDistanceChunk
    assert chosen(floor(0.5), None) is PoissonChunk


@pytest.mark.parametrize(
    ("surface", "kind"), [("poisson", PoissonChunk), ("signed-distance", SignedDistanceChunk)]
)
def test_a_named_surface_is_taken(surface: str, kind: type):
    assert chosen(floor(0.0), POSES, surface=surface) is kind
    assert chosen(floor(0.5), None, surface=surface) is kind


def test_the_papers_method_has_poissons_unless_another_is_named():
    assert BuildConfig().surface.surface == "auto"
    paper = {"engine": {"method": "paper"}}
    assert BuildConfig.parse(paper).surface.surface == "poisson"
    named = BuildConfig.parse(paper | {"reconstruct": {"surface": "signed-distance"}})
    assert named.surface.surface == "signed-distance"


def test_how_far_surfaces_usually_are_is_measured_in_steps():
    before = mesh_chunks(floor(0.0), POSES, ReconstructConfig())
    nudged = POSES.copy()
    nudged[0, 0, 3] += 0.05
    assert mesh_chunks(floor(0.0), nudged, ReconstructConfig()) == before
    away = POSES.copy()
    away[:, 2, 3] += 10
    assert mesh_chunks(floor(0.0), away, ReconstructConfig()) != before

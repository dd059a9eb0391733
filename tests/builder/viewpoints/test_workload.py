"""Maps that would keep a builder busy for days are refused before the work, with the figures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from firstfix.builds.config import BuildConfig, ViewpointConfig
from firstfix.errors import BuildFailed
from firstfix_builder import pipeline
from firstfix_builder.mesh.mesh import Mesh
from firstfix_builder.mesh.tiled_mesh import TiledMesh
from firstfix_builder.viewpoints.workload import Workload

PLAIN = "0 0 0\n10000 0 0\n10000 10000 0\n0 10000 0\n3 0 1 2\n3 0 2 3\n"
FINE = {"level": False, "viewpoints": {"spacing_m": 0.5}}


def plain_mesh(path: Path) -> Path:
    """Two triangles, 10 x 10 km."""
    head = "ply\nformat ascii 1.0\nelement vertex 4\n"
    head += "".join(f"property float {axis}\n" for axis in "xyz")
    path.write_text(head + "element face 2\nproperty list uchar int vertex_indices\nend_header\n" + PLAIN)
    return path


def line(path: Path) -> Path:
    """A million points on 100 km, which rise by 1 km."""
    along = np.linspace(0, 1e5, 1_000_000)
    np.save(path, np.c_[along, np.zeros(len(along)), along / 100].astype(np.float32))
    return path


def plain_cloud(path: Path) -> Path:
    """Points on 3.3 x 3.3 km."""
    cloud = np.random.default_rng(0).uniform(0, 1, (1_000_000, 3)) * [3300, 3300, 2]
    np.save(path, cloud.astype(np.float32))
    return path


@pytest.mark.parametrize(
    ("make", "name", "config", "why"),
    [
        (plain_mesh, "plain.ply", {}, r"floors of 100,000,000 m2 .* 100,000,000 templates.* 4,000,000"),
        (plain_mesh, "plain.ply", {"viewpoints": {"spacing_m": 2}}, "about 25,000,000 templates"),
        (line, "line.npy", {}, "1000000 points lie on a line"),
        (plain_cloud, "plain.npy", FINE, "extent of .* 10 times 4,000,000.*MAX_TEMPLATES"),
    ],
)
def test_small_files_of_large_maps_end_before_the_work(tmp_path, monkeypatch, make, name, config, why):
    """No chunk is run, neither for the provisional nor for the full version."""
    monkeypatch.setattr("firstfix_builder.sources.write_level_map.clean_cloud", lambda cloud, config: cloud)
    chunks = []
    monkeypatch.setattr(
        "firstfix_builder.execution.chunks.ChunkCache.run", lambda self, *given: chunks.append(given)
    )
    published = []
    with pytest.raises(BuildFailed, match=why) as refused:
        pipeline.build_version(
            make(tmp_path / name),
            BuildConfig.parse(config),
            tmp_path / "work",
            publish_provisional=published.append,
        )
    assert len(str(refused.value)) < 400
    assert chunks == published == []


def floor(side_m: float, rise: float = 0.0) -> TiledMesh:
    corners = np.array(
        [[0, 0, 0], [side_m, 0, 0], [side_m, side_m, rise * side_m], [0, side_m, rise * side_m]]
    )
    return TiledMesh.of(Mesh(corners.astype(float), np.array([[0, 1, 2], [0, 2, 3]])))


def poses(*places: tuple[float, float]) -> np.ndarray:
    T = np.tile(np.eye(4), (len(places), 1, 1))
    T[:, :2, 3] = places
    return T


def test_the_limit_is_the_estimate():
    Workload(10_001).check_mesh(floor(100.0), None, ViewpointConfig(), 1.0)
    with pytest.raises(BuildFailed, match="about 10,000 templates"):
        Workload(9_999).check_mesh(floor(100.0), None, ViewpointConfig(), 1.0)
    Workload(9_999).check_mesh(floor(100.0), None, ViewpointConfig(), 1.1)
    Workload(None).check_mesh(floor(1e6), None, ViewpointConfig(), 0.1)


def test_what_is_too_steep_is_no_floor_but_is_looked_at():
    Workload(2_000).check_mesh(floor(100.0, rise=1.0), None, ViewpointConfig(), 1.0)
    with pytest.raises(BuildFailed, match="on its extent"):
        Workload(1_000).check_mesh(floor(100.0, rise=1.0), None, ViewpointConfig(), 1.0)


def test_only_the_surroundings_of_a_trajectory_count_where_the_config_says_so():
    near = ViewpointConfig(max_distance_to_trajectory_m=4)
    track = poses(*((x, 50.0) for x in range(100)))
    Workload(2_000).check_mesh(floor(3_000.0), track, near, 1.0)
    Workload(200).check_cloud(np.random.default_rng(0).uniform(0, 500, (100_000, 3)), track, near)
    with pytest.raises(BuildFailed, match="templates"):
        Workload(2_000).check_mesh(floor(3_000.0), track, ViewpointConfig(), 1.0)
    with pytest.raises(BuildFailed, match="templates"):
        Workload(2_000).check_mesh(floor(3_000.0), None, near, 1.0)


def test_a_spacing_that_is_advised_is_enough():
    with pytest.raises(BuildFailed, match=r"set viewpoints.spacing_m to 3.2 or") as refused:
        Workload(1_000).check_mesh(floor(100.0), None, ViewpointConfig(), 1.0)
    assert "FIRSTFIX_BUILD_MAX_TEMPLATES" in str(refused.value)
    Workload(1_000).check_mesh(floor(100.0), None, ViewpointConfig(), 3.2)


def test_templates_that_no_estimate_saw_are_counted():
    Workload(100).check_found(100, 0.5)
    with pytest.raises(BuildFailed, match=r"101 templates, one every 0\.5 m"):
        Workload(100).check_found(101, 0.5)


def test_a_narrow_street_is_no_line():
    street = np.random.default_rng(0).uniform(0, 1, (10_000, 3)) * [5000, 3, 0.1]
    Workload().check_cloud(street, None, ViewpointConfig())
